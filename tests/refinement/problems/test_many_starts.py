"""Several starts at once end where each ends alone."""

import jax
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import pose_error
from oracles.rooms import VOXEL
from voxjax.refinement.problems.many_starts import solve_starts
from voxjax.refinement.problems.pair import as_dtype, pose_problem
from voxjax.refinement.refine import refine

POINTS = 512
SCALES = np.asarray([2.0, 1.0], np.float32) * np.float32(VOXEL)


def test_several_starts_end_where_each_ends_alone(prepared, room, starts):
    found = refine(prepared[0], prepared[1], starts[:3], num_points=POINTS)
    assert found.T_a_b.shape == (3, 4, 4)
    assert found.covariance.shape == (3, 6, 6)
    for k in range(2):
        alone = refine(prepared[0], prepared[1], starts[k], num_points=POINTS)
        angle, gap = pose_error(found.T_a_b[k], alone.T_a_b, prepared[1].centroid)
        assert angle < 0.1
        assert gap < 0.1 * VOXEL
        assert found.cost_after[k] <= found.cost_before[k]
    np.testing.assert_allclose(found.T_a_b[2], starts[2])
    is_degenerate = [bool(result) for result in np.asarray(found.result == vx.RESULTS.degenerate)]
    assert is_degenerate == [False, False, True]
    with pytest.raises(vx.InputError, match=r"T_a_b\[1\]"):
        refine(prepared[0], prepared[1], starts[[0, 3]], num_points=POINTS)
    with pytest.raises(vx.InputError, match="at least one"):
        refine(prepared[0], prepared[1], starts[:0], num_points=POINTS)


def test_several_starts_in_float64(prepared, starts):
    with jax.enable_x64(True):
        problem = as_dtype(pose_problem(*prepared, num_points=POINTS), np.float64)
        found = solve_starts(problem, starts[:2].astype(np.float64), SCALES.astype(np.float64))
    assert found.T_a_b.dtype == np.float64
    assert (found.cost_after < found.cost_before).all()
