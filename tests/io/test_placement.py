"""Maps brought to another unit and moved while they are read."""

import numpy as np
import pytest

import voxjax as vx
from clouds import room_points, write_cloud
from stray_rooms import room
from voxjax import InputError
from voxjax.io import load_map
from voxjax.io.placement import check_placement

FAR = np.array([450_000.25, 5_400_000.5, 300.0])


def some_grid():
    states = np.random.default_rng(0).integers(0, 3, (6, 5, 4)).astype(np.uint8)
    states[[0, -1], 0, 0] = states[0, [0, -1], 0] = states[0, 0, [0, -1]] = 2
    return vx.VoxelGrid(states, [-0.5, 1.0, 0.25], 0.25)


@pytest.mark.parametrize("ending", [".npz", ".bt", ".ot", ".zarr"])
def test_maps_of_voxels_keep_them_and_are_elsewhere(tmp_path, ending):
    path, grid = tmp_path / f"m{ending}", some_grid()
    vx.write_map(path, grid)
    moved = vx.read_map(path, scale=2.0, shift=FAR)
    assert moved.voxel_size == 0.5
    np.testing.assert_array_equal(moved.states_in((0, 0, 0), moved.shape), grid.states)
    np.testing.assert_array_equal(moved.origin, 2.0 * np.array([-0.5, 1.0, 0.25]) + FAR)
    # The box is one of the file's own frame, and the voxel size one of the result.
    box = ([-0.5, 1.0, 0.25], [0.0, 1.5, 0.75])
    cut = vx.read_map(path, scale=2.0, shift=FAR, crop=box)
    assert cut == vx.read_map(path, crop=box).placed(scale=2.0, shift=FAR)
    coarse = vx.read_map(path, scale=2.0, shift=(0.0, 0.25, 0.0), voxel_size=1.0)
    assert coarse == vx.read_map(path).placed(scale=2.0, shift=(0.0, 0.25, 0.0)).with_voxel_size(1.0)
    assert (coarse.origin % 1.0 == 0.0).all()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_points_of_clouds_are_moved_before_there_are_voxels(tmp_path, kind):
    path, points = tmp_path / "c.ply", (1000.0 * room_points(0.1)).astype(kind)
    write_cloud(path, points)
    shift = np.array([0.03, -7.0, 4e5])
    expected = points.astype(np.float64) * 0.001 + shift
    found = vx.read_map(path, voxel_size=0.2, scale=0.001, shift=shift)
    assert found == vx.VoxelGrid.from_points(expected, voxel_size=0.2)
    sensor = points.mean(axis=0)
    seen = vx.read_map(path, voxel_size=0.5, scale=0.001, shift=shift, sensor_origins=sensor)
    origins = sensor.astype(np.float64) * 0.001 + shift
    assert seen == vx.VoxelGrid.from_points(expected, voxel_size=0.5, sensor_origins=origins)
    assert seen.num_free
    middle = np.median(points, axis=0)
    low, high = np.full(3, -np.inf), np.append(middle[:2], np.inf)
    cut = vx.read_map(path, voxel_size=0.5, scale=0.001, shift=shift, sensor_origins=sensor, crop=(low, high))
    assert 0 < cut.num_occupied < seen.num_occupied
    assert cut.extent[1][0] <= 0.001 * high[0] + shift[0] + 0.5


def test_a_cloud_in_millimetres_is_one_in_metres_with_the_scale_that_its_remark_names(tmp_path):
    write_cloud(tmp_path / "mm.ply", 1000.0 * room_points(0.1))
    write_cloud(tmp_path / "m.ply", room_points(0.1))
    (hint,) = [remark for remark in load_map(tmp_path / "mm.ply").remarks if remark.code == "units"]
    assert "voxjax convert --scale 0.001" in hint.text
    scaled, metres = load_map(tmp_path / "mm.ply", scale=0.001), load_map(tmp_path / "m.ply")
    assert scaled.grid.voxel_size == metres.grid.voxel_size
    assert [remark.code for remark in scaled.remarks] == [remark.code for remark in metres.remarks]
    assert scaled.grid.num_occupied == pytest.approx(metres.grid.num_occupied, rel=0.02)


@pytest.mark.parametrize("ending", [".npz", ".bt"])
def test_remarks_are_about_the_map_where_it_will_lie(tmp_path, ending):
    path, grid = tmp_path / f"m{ending}", room().placed(scale=1000.0)
    vx.write_map(path, grid)
    assert {remark.code for remark in load_map(path).remarks} == {"isolated", "units"}
    (isolated,) = load_map(path, scale=0.001).remarks
    vx.write_map(path, room())
    (expected,) = load_map(path).remarks
    assert isolated.numbers == pytest.approx(expected.numbers)


def test_single_precision_that_has_lost_the_points_is_said_whatever_the_shift(tmp_path):
    rounded = (room_points(0.1) + FAR).astype(np.float32)
    write_cloud(tmp_path / "c.ply", rounded)
    with pytest.raises(InputError, match="a shift of this file brings nothing back"):
        vx.read_map(tmp_path / "c.ply", voxel_size=0.1, shift=-FAR)


def test_what_is_beyond_the_digits_of_float64_can_be_moved_back(tmp_path):
    grid = vx.VoxelGrid(some_grid().states, [8e11, 0.0, 0.0], 0.001)
    vx.write_map(tmp_path / "m.npz", grid)
    with pytest.raises(InputError, match="voxjax convert --shift"):
        vx.read_map(tmp_path / "m.npz")
    back = vx.read_map(tmp_path / "m.npz", shift=(-8e11, 0.0, 0.0))
    np.testing.assert_array_equal(back.origin, np.zeros(3))


@pytest.mark.parametrize(
    ("scale", "shift", "words"),
    [
        (0.0, (0, 0, 0), "scale must be a finite number above 0"),
        (np.nan, (0, 0, 0), "scale must be a finite number above 0"),
        (1.0, (0, 0), "shift must be three numbers"),
        (1.0, (0, np.nan, 0), "shift must be three numbers"),
        (1.0, "far", "shift must be three numbers"),
    ],
)
def test_other_placements_are_refused(scale, shift, words):
    with pytest.raises(InputError, match=words):
        check_placement(scale, shift)


def test_no_placement_is_none():
    assert check_placement(1.0, (0, 0, 0)) is None
