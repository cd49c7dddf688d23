import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from corner_lists import clouds, corners_at
from oracles.matching import consistency, is_clique, largest_common_subgraph
from voxjax import RESULTS, InputError, consistency_graph, maximum_common_subgraph
from voxjax.matching.backtracking import EARLY_COST, backtrack
from voxjax.matching.common_subgraph import subgraph_from_graph


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), n=st.integers(1, 7), m=st.integers(1, 7), tolerance=st.floats(0.05, 1.5)
)
def test_clique_and_backtracking_find_the_same_schemes(seed, n, m, tolerance):
    rng = np.random.default_rng(seed)
    a, b = corners_at(rng.uniform(0, 4, (n, 3))), corners_at(rng.uniform(0, 4, (m, 3)))
    options = {"distance_tolerance": tolerance, "max_ties": 5000}
    clique = maximum_common_subgraph(a, b, **options)
    search = maximum_common_subgraph(a, b, method="backtracking", **options)
    assert clique.completed
    assert search.completed
    assert len(clique) == len(search)
    as_sets = [{tuple(map(tuple, t.tolist())) for t in x.ties} for x in (clique, search)]
    assert as_sets[0] == as_sets[1]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5), m=st.integers(1, 5))
def test_size_equals_brute_force_over_all_partial_maps(seed, n, m):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 3, (n, 3)), rng.uniform(0, 3, (m, 3))
    found = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.4)
    assert len(found) == largest_common_subgraph(a, b, 0.4)


@pytest.mark.parametrize("method", ["clique", "backtracking"])
def test_shared_corners_are_found_among_strangers(method):
    a, b, _ = clouds(1, 20, 22, 12, noise=0.01)
    found = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.1, method=method)
    assert found.result == RESULTS.successful
    assert found.associations[:12].tolist() == [[k, k] for k in range(12)]
    assert is_clique(consistency(a, b, found.associations.tolist(), 0.1), range(len(found)))


@pytest.mark.parametrize("method", ["clique", "backtracking"])
def test_each_corner_is_used_once(method):
    a, b, _ = clouds(2, 15, 15, 8)
    found = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.5, method=method)
    assert len(set(found[:, 0].tolist())) == len(set(found[:, 1].tolist())) == len(found)


def test_swapping_the_maps_swaps_the_pairs():
    a, b, _ = clouds(3, 10, 12, 7)
    forth = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.1)
    back = maximum_common_subgraph(corners_at(b), corners_at(a), distance_tolerance=0.1)
    assert sorted(forth.associations.tolist()) == sorted(p[::-1] for p in back.associations.tolist())


def test_the_early_transform_recovers_what_five_matches_imply():
    a, b, _ = clouds(4, 25, 25, 14, noise=0.02)
    found = maximum_common_subgraph(
        corners_at(a), corners_at(b), distance_tolerance=0.15, method="backtracking", early_transform=True
    )
    matched = {tuple(p) for p in found.associations.tolist()}
    assert matched >= {(k, k) for k in range(14)}
    exact = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.15)
    assert found.num_nodes < 10 * EARLY_COST + 10_000
    assert len(found) >= len(exact)


def test_the_early_transform_is_asked_at_five_matches_only():
    a, b, _ = clouds(6, 8, 8, 8)
    graph = consistency_graph(corners_at(a), corners_at(b), distance_tolerance=0.05)
    sizes = []

    def extend(matches):
        sizes.append(len(matches))
        return matches

    found = backtrack(graph.associations[: graph.num_associations], graph.adjacency, extend=extend)
    assert set(sizes) == {5}
    assert len(found.schemes[0]) == 5


def test_ties_beyond_the_limit_are_reported():
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    for method in ("clique", "backtracking"):
        found = maximum_common_subgraph(
            corners_at(square), corners_at(square), distance_tolerance=0.1, method=method, max_ties=3
        )
        assert len(found) == 4
        assert len(found.ties) == 3
        assert not found.has_all_ties
        # A square has 8 symmetries of its distances.
        every = maximum_common_subgraph(
            corners_at(square), corners_at(square), distance_tolerance=0.1, method=method
        )
        assert len(every.ties) == 8
        assert every.has_all_ties


def test_given_associations_restrict_the_search():
    a, b, _ = clouds(8, 6, 6, 6)
    pairs = np.array([[0, 0], [1, 1], [2, 2], [3, 4]])
    found = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.05, associations=pairs)
    assert found.associations.tolist() == [[0, 0], [1, 1], [2, 2]]


def test_no_corners_and_single_corners_are_outcomes():
    for n, m, size in ((0, 3, 0), (1, 1, 1), (2, 0, 0)):
        for method in ("clique", "backtracking"):
            found = maximum_common_subgraph(
                corners_at(np.zeros((n, 3))),
                corners_at(np.zeros((m, 3))),
                distance_tolerance=0.1,
                method=method,
            )
            assert found.result == RESULTS.too_few_associations
            assert found.shape == (size, 2)


def test_the_result_reads_as_an_array():
    a, b, _ = clouds(9, 8, 8, 8)
    found = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.05)
    assert np.asarray(found).tolist() == found.associations.tolist()
    assert [p.tolist() for p in found] == found.associations.tolist()
    assert found[0].tolist() == [0, 0]
    assert found.shape == (8, 2)


def test_a_graph_made_before_gives_the_same():
    a, b, _ = clouds(10, 9, 9, 6)
    graph = consistency_graph(corners_at(a), corners_at(b), distance_tolerance=0.1)
    direct = maximum_common_subgraph(corners_at(a), corners_at(b), distance_tolerance=0.1)
    assert subgraph_from_graph(graph, max_ties=1).associations.tolist() == direct.associations.tolist()


def test_a_time_budget_needs_the_clique_search():
    a = np.eye(3)
    with pytest.raises(InputError, match="max_seconds"):
        maximum_common_subgraph(
            corners_at(a), corners_at(a), distance_tolerance=0.1, method="backtracking", max_seconds=1.0
        )
