from corner_lists import clouds, corners_at
from voxjax import RESULTS, maximum_common_subgraph


def test_backtracking_reports_its_budget():
    a, b, _ = clouds(7, 20, 20, 10)
    found = maximum_common_subgraph(
        corners_at(a), corners_at(b), distance_tolerance=0.5, method="backtracking", max_nodes=50
    )
    assert not found.completed
    assert found.num_nodes <= 50
    assert found.result in (RESULTS.budget_exhausted, RESULTS.too_few_associations)
