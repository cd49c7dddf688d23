"""Maps of clouds: voxel sizes, cuts, and what is said about them."""

import warnings

import numpy as np
import pytest

import voxjax as vx
from clouds import room_points, write_cloud
from voxjax import InputError
from voxjax.io import MapWarning, load_map

ROOM = room_points(0.1)
NOWHERE = np.array([[np.nan, 0, 0], [np.inf, 1, 1]])
STRAY = np.array([[600.0, 0.0, 0.0]])


def codes(loaded):
    return [remark.code for remark in loaded.remarks]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "c.ply"


def test_a_good_cloud_with_a_voxel_size_has_no_remark(path):
    write_cloud(path, ROOM)
    loaded = load_map(path, voxel_size=0.2)
    assert loaded.remarks == ()
    assert loaded.grid == vx.read_map(path, voxel_size=0.2)
    assert loaded.grid == vx.VoxelGrid.from_points(ROOM, voxel_size=0.2)


@pytest.mark.parametrize("scale", [0.2, 0.5, 5.0, 20.0])
def test_without_a_voxel_size_it_is_estimated_and_said(path, scale):
    write_cloud(path, scale * ROOM)
    loaded = load_map(path)
    (remark,) = loaded.remarks
    assert remark.code == "estimated_voxel_size"
    assert remark.numbers["voxel_size"] == loaded.grid.voxel_size
    assert f"voxel size estimated: {loaded.grid.voxel_size:g} m" in remark.text
    assert 0.09 * scale < loaded.grid.voxel_size < 0.26 * scale
    assert vx.read_map(path) == loaded.grid


def test_points_that_are_no_places_are_left_out_with_a_count(path):
    write_cloud(path, np.concatenate([NOWHERE, ROOM]))
    loaded = load_map(path, voxel_size=0.2)
    assert loaded.grid == vx.VoxelGrid.from_points(ROOM, voxel_size=0.2)
    assert codes(loaded) == ["not_finite"]
    assert loaded.remarks[0].numbers == {"num_dropped": 2, "num_points": len(ROOM) + 2}
    with pytest.warns(MapWarning, match=rf"c\.ply: 2 of {len(ROOM) + 2:,} points are NaN or infinite"):
        assert vx.read_map(path, voxel_size=0.2) == loaded.grid
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)
        vx.read_map(path, voxel_size=0.2)
    with pytest.raises(InputError, match=r"c\.ply cannot be read: 2 of .* strict"):
        vx.read_map(path, voxel_size=0.2, strict=True)


def test_each_kept_point_keeps_its_sensor(path):
    points = np.array([[0.05, 0.05, 0.05], [np.nan, 0, 0], [1.05, 2.05, 0.05]])
    sensors = np.array([[0.55, 0.05, 0.05], [9.0, 9.0, 9.0], [1.05, 1.55, 0.05]])
    write_cloud(path, points)
    grid = load_map(path, voxel_size=0.1, sensor_origins=sensors).grid
    assert grid == vx.VoxelGrid.from_points(points[[0, 2]], voxel_size=0.1, sensor_origins=sensors[[0, 2]])


def test_equal_points_are_counted_and_strict_refuses_them(path):
    write_cloud(path, np.concatenate([ROOM, ROOM[:3]]))
    loaded = load_map(path, voxel_size=0.2)
    assert codes(loaded) == ["duplicates"]
    assert loaded.remarks[0].numbers["num_duplicates"] == 3
    assert load_map(path).grid.voxel_size == load_map(path, voxel_size=0.2).grid.voxel_size
    with pytest.raises(InputError, match=r"3 of .* points are equal to others.*strict"):
        vx.read_map(path, voxel_size=0.2, strict=True)
    write_cloud(path, ROOM)
    assert vx.read_map(path, voxel_size=0.2, strict=True) == loaded.grid


def test_points_at_corners_of_voxels_lie_on_faces(path):
    index = np.unique(np.floor(room_points(1.0)), axis=0)
    for shift, expected in ((0.0, ["estimated_voxel_size", "on_faces"]), (0.5, ["estimated_voxel_size"])):
        write_cloud(path, (index + shift) * 0.1, "float")
        loaded = load_map(path)
        assert codes(loaded) == expected
        assert loaded.grid.voxel_size == 0.1
    # Centres of voxels half as large lie on no face of voxels twice as large.
    assert codes(load_map(path, voxel_size=0.2)) == []


def test_a_crop_keeps_the_points_in_the_box(path):
    write_cloud(path, ROOM)
    low, high = np.quantile(ROOM, [0.2, 0.8], axis=0)
    inside = ((ROOM >= low) & (ROOM < high)).all(axis=1)
    found = vx.read_map(path, voxel_size=0.2, crop=(low, high))
    assert found == vx.VoxelGrid.from_points(ROOM[inside], voxel_size=0.2)
    with pytest.raises(InputError, match=r"c\.ply cannot be read: .* nothing in the crop"):
        vx.read_map(path, voxel_size=0.2, crop=([50, 50, 50], [60, 60, 60]))
    with pytest.raises(InputError, match="crop must be a low and a high corner"):
        vx.read_map(path, voxel_size=0.2, crop=[0, 0, 0, 1, 1, 1])


def test_a_crop_keeps_what_rays_to_points_outside_of_it_have_seen(path):
    write_cloud(path, [[5.05, 0.05, 0.05]])
    sensor = [0.05, 0.05, 0.05]
    box = ([0.0, 0.0, 0.0], [1.0, 0.1, 0.1])
    grid = vx.read_map(path, voxel_size=0.1, sensor_origins=sensor, crop=box)
    assert (grid.num_free, grid.num_occupied, grid.shape) == (10, 0, (10, 1, 1))


def test_isolated_points_are_said_and_left_out_on_request(path):
    write_cloud(path, np.concatenate([STRAY, ROOM]))
    loaded = load_map(path, voxel_size=0.2)
    assert codes(loaded) == ["isolated"]
    assert loaded.remarks[0].numbers["num_voxels"] == 1
    assert 580 < loaded.remarks[0].numbers["farthest_m"] < 620
    assert not loaded.remarks[0].numbers["is_dropped"]
    assert loaded.grid.shape[0] > 2900
    dropped = load_map(path, voxel_size=0.2, drop_isolated=True)
    assert dropped.grid == vx.VoxelGrid.from_points(ROOM, voxel_size=0.2)
    assert dropped.remarks[0].numbers["is_dropped"]
    assert vx.read_map(path, voxel_size=0.2, drop_isolated=True) == dropped.grid


def test_a_box_that_is_too_large_is_refused_with_its_reason(path):
    write_cloud(path, np.concatenate([STRAY * [1e4, 1, 1] + [0, 1e6, 1e6], ROOM]))
    with pytest.raises(InputError, match=r"points span .*; isolated from the rest by .*--drop-isolated"):
        load_map(path, voxel_size=0.2)
    assert load_map(path, voxel_size=0.2, drop_isolated=True).grid.shape[0] < 100
    write_cloud(path, ROOM * 1000)
    with pytest.raises(InputError, match=r"points span .*hints at millimetres.*by 0.001"):
        load_map(path, voxel_size=0.2)


def test_single_precision_far_from_zero_is_refused_and_doubles_are_not(path):
    far = ROOM + [4.5e5, 5.4e6, 300.0]
    write_cloud(path, far, "float")
    for size in (None, 0.2):
        with pytest.raises(InputError, match=r"c\.ply cannot be read: its y coordinates .* with doubles"):
            vx.read_map(path, voxel_size=size)
    write_cloud(path, far)
    loaded = load_map(path)
    assert codes(loaded) == ["estimated_voxel_size", "far_frame"]
    assert loaded.grid.num_occupied == pytest.approx(
        vx.VoxelGrid.from_points(ROOM, voxel_size=loaded.grid.voxel_size).num_occupied, rel=0.02
    )
