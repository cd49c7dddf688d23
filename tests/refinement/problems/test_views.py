"""A map as the residuals see it: by its states, or by log-odds that are as good as certain."""

import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.refinement.problems.views import as_view, hard_view, soft_map, views_of


def test_certain_log_odds_see_what_the_states_see(room):
    grid = room[0]
    states = np.asarray(grid.states)
    view = soft_map(grid).view(jnp.asarray(np.where(states == 2, 30.0, -30.0), jnp.float32))
    hard = hard_view(view.prepared)
    count = view.prepared.num_points
    assert view.occupancy is not None
    np.testing.assert_allclose(view.occupancy[:count], 1.0, atol=1e-6)
    assert view.said is not None
    is_known = np.asarray(view.prepared.grid.states) != 0
    expected = np.where(np.asarray(view.prepared.grid.states) == 2, 1.0, -1.0)
    np.testing.assert_allclose(np.asarray(view.said)[is_known], expected[is_known], atol=1e-5)
    is_flat = np.asarray(hard.planarity)[:count] > 0.9
    across = np.sum(np.asarray(view.normals)[:count] * np.asarray(hard.normals)[:count], axis=1)
    assert np.median(np.abs(across[is_flat])) > 0.99


def test_views_are_taken_as_they_are_and_empty_maps_have_none(prepared):
    view = hard_view(prepared[0])
    assert as_view(view) is view
    assert as_view(prepared[0]).prepared is prepared[0]
    empty = VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), 0.1)
    assert views_of({"a": prepared[0], "b": empty}, soft=False)[1] is None


def test_soft_maps_need_log_odds_and_voxels(room):
    with pytest.raises(InputError, match="b must be a VoxelGrid with log_odds"):
        views_of({"b": room[0]}, soft=True)
    with pytest.raises(InputError, match="at least one occupied voxel"):
        soft_map(VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), 0.1))
