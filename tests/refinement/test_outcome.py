"""How a refinement ends, and what is said where there was nothing to refine."""

import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import RESULTS
from voxjax.refinement.outcome import has_ended, how_it_ended, unrefined_pose, unrefined_poses


@pytest.mark.parametrize(
    ("converged", "is_degenerate", "expected"),
    [
        (True, False, RESULTS.successful),
        (False, False, RESULTS.not_converged),
        (True, True, RESULTS.degenerate),
        (False, True, RESULTS.degenerate),
    ],
)
def test_a_pose_that_slides_is_degenerate_whether_it_converged_or_not(converged, is_degenerate, expected):
    assert how_it_ended(jnp.asarray(converged), jnp.asarray(is_degenerate)) == expected


def test_a_cost_that_is_no_number_is_no_end():
    costs = jnp.asarray([0.1, np.nan, np.inf, 0.1])
    assert has_ended(jnp.asarray([True, True, True, False]), costs).tolist() == [True, False, False, False]


def test_without_voxels_the_start_stays_and_nothing_is_known():
    start = np.eye(4, dtype=np.float32)
    alone = unrefined_pose(start)
    assert alone.result == RESULTS.empty_map
    np.testing.assert_array_equal(alone.T_a_b, start)
    np.testing.assert_array_equal(alone.covariance, np.eye(6))
    several = unrefined_pose(np.stack([start] * 3))
    assert several.covariance.shape == (3, 6, 6)
    assert several.num_steps.tolist() == [0, 0, 0]


def test_without_a_pair_all_maps_are_held():
    found = unrefined_poses(np.stack([np.eye(4, dtype=np.float32)] * 2), RESULTS.no_overlap, (0, 1), (1,))
    assert found.result == RESULTS.no_overlap
    assert (found.pairs, found.held, found.unpaired) == ((), (0, 1), (1,))
    assert not found.covariance.any()
    assert found.cost_before == found.cost_after == 1.0
