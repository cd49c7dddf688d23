"""Files of all formats are cut and looked over alike."""

import numpy as np
import pytest

import voxjax as vx
from stray_rooms import room
from voxjax.io import load_map
from voxjax.io.strays import without_strays


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
