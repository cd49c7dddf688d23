"""Isolated far pieces of dense maps."""

import numpy as np
import pytest

import voxjax as vx
from voxjax.io import load_map
from voxjax.io.strays import without_strays


def room(*, log_odds=False):
    """A closed room of 0.2 m voxels in a long box, with a stray voxel at its end and a row of free ones before it."""
    states = np.zeros((400, 12, 10), np.uint8)
    states[:14] = 2
    states[1:13, 1:11, 1:9] = 1
    states[14:399, 5, 5] = 1
    states[399, 5, 5] = 2
    odds = np.choose(states, [np.float32(0), np.float32(-2), np.float32(3)]) if log_odds else None
    return vx.VoxelGrid(states, [1.0, 2.0, 3.0], 0.2, odds)


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


@pytest.mark.parametrize("ending", [".npz", ".bt", ".ot"])
def test_files_of_all_formats_are_cut_alike(tmp_path, ending):
    path = tmp_path / f"m{ending}"
    vx.write_map(path, room())
    loaded = load_map(path)
    assert [remark.code for remark in loaded.remarks] == ["isolated"]
    assert loaded.grid.shape == (400, 12, 10)
    dropped = vx.read_map(path, drop_isolated=True)
    assert dropped.num_occupied == loaded.grid.num_occupied - 1
    assert dropped.shape[0] < 50
    cut = vx.read_map(path, crop=([1.0, 2.0, 3.0], [3.8, 4.4, 5.0]))
    np.testing.assert_array_equal(cut.states, np.asarray(room().states)[:14])
    coarse = vx.read_map(path, drop_isolated=True, voxel_size=0.4)
    assert coarse == dropped.with_voxel_size(0.4)


@pytest.mark.parametrize("ending", [".npz", ".bt", ".ot"])
@pytest.mark.parametrize("voxel_size", [None, 5.0])
def test_remarks_are_about_the_file_whatever_its_format_and_the_voxel_size_asked_for(
    tmp_path, ending, voxel_size
):
    path = tmp_path / f"m{ending}"
    for states in (np.asarray(room().states), np.ones((3, 3, 3), np.uint8)):
        # A tenth of a metre, in feet.
        grid = vx.VoxelGrid(states, np.zeros(3), 0.328084)
        vx.write_map(path, grid)
        expected = without_strays(grid, is_dropped=False)[1]
        remarks = load_map(path, voxel_size=voxel_size).remarks
        assert [remark.code for remark in remarks] == [remark.code for remark in expected]
        for remark, other in zip(remarks, expected, strict=True):
            assert remark.numbers == pytest.approx(other.numbers)
