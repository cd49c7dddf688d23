"""Isolated far pieces of dense maps."""

import numpy as np
import pytest

import voxjax as vx
from stray_rooms import room
from voxjax.io.strays import without_strays


@pytest.mark.parametrize("log_odds", [False, True])
def test_strays_and_the_free_space_on_the_way_to_them_are_left_out(log_odds):
    grid = room(log_odds=log_odds)
    kept, (remark,) = without_strays(grid, is_dropped=True)
    assert (remark.code, remark.numbers["num_voxels"]) == ("isolated", 1)
    assert remark.numbers["farthest_m"] == pytest.approx((399 - 13) * 0.2)
    assert "left out" in remark.text
    assert kept.num_occupied == grid.num_occupied - 1
    # What belongs to the room is wider than it by its diagonal.
    length = 14 + np.linalg.norm([14, 12, 10])
    assert kept.shape == (round(length), 12, 10)
    np.testing.assert_array_equal(kept.states, np.asarray(grid.states)[: kept.shape[0]])
    np.testing.assert_allclose(kept.origin, grid.origin)
    if log_odds:
        np.testing.assert_array_equal(kept.log_odds, np.asarray(grid.log_odds)[: kept.shape[0]])


def test_nothing_is_left_out_unasked():
    grid = room()
    kept, (remark,) = without_strays(grid, is_dropped=False)
    assert kept is grid
    assert "--drop-isolated" in remark.text
    whole = vx.VoxelGrid(np.asarray(grid.states)[:14], grid.origin, 0.2)
    assert without_strays(whole, is_dropped=True) == (whole, [])


def test_a_map_without_an_occupied_voxel_has_no_strays():
    grid = vx.VoxelGrid(np.ones((3, 3, 3), np.uint8), np.zeros(3), 0.1)
    assert without_strays(grid, is_dropped=True) == (grid, [])
