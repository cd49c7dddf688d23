"""Parts of the benchmark of refinement: what counts as converged, rows of methods that are known to be good or bad."""

import pytest
from bench.refinement_parts import Plan, accuracy_rows, basin_rows, has_converged
from refinement_rows import made_case, made_pair, refiner

from voxjax.metrics import PoseError


@pytest.mark.parametrize(
    ("metres", "degrees", "voxel_size", "expected"),
    [
        (0.149, 0.99, 0.1, True),
        (0.151, 0.0, 0.1, False),
        (0.19, 0.0, 0.2, True),
        (0.0, 1.01, 0.2, False),
    ],
)
def test_what_counts_as_converged(metres, degrees, voxel_size, expected):
    assert has_converged(PoseError(degrees, metres), voxel_size) == expected


def test_rows_tell_a_perfect_method_from_one_that_does_nothing():
    pair = made_pair()
    plan = Plan([made_case(pair)], [made_case(pair)], starts=2, levels=3, seed=1)
    methods = [refiner("perfect", lambda pair, T: pair.T_a_b), refiner("idle", lambda pair, T: T)]
    perfect, idle = accuracy_rows(plan, methods)
    assert (perfect["converged"], idle["converged"]) == (1.0, 0.0)
    assert perfect["metres"] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert idle["metres"] == pytest.approx([0.3, 0.3])
    assert idle["voxels"] == pytest.approx([3.0, 3.0])
    assert idle["degrees"] == pytest.approx([3.0, 3.0])
    assert idle["num_poses"] == 2
    rows = {(row["line"], row["method"]): row for row in basin_rows(plan, methods)}
    assert rows["both", "perfect"]["converged"] == [1.0, 1.0, 1.0]
    assert rows["both", "idle"]["converged"] == [1.0, 0.0, 0.0]
    assert rows["both", "idle"]["num_trials"] == [1, 2, 2]
    assert rows["translation", "idle"]["degrees"] == [0.0, 0.0, 0.0]
    assert rows["rotation", "idle"]["degrees"] == [0.0, 15.0, 30.0]
