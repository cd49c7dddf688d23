import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.raycast import crossed_by_clipping
from voxjax import VoxelGrid
from voxjax._checks import InputError
from voxjax._types import FREE, OCCUPIED, UNKNOWN
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.resampling.from_points import grid_from_points


def dense_from_points(*args, **options):
    states, origin = grid_from_points(*args, **options)
    assert isinstance(states, np.ndarray)
    return states, origin


ROUNDING = 1e-4  # voxels: float32 may give or withhold a voxel that the ray only touches


def test_cloud_without_origins_marks_only_its_voxels():
    points = np.asarray([[0.05, -0.05, 0.31], [0.07, -0.02, 0.33], [1.04, 0.5, 0.3]], np.float32)
    states, origin = dense_from_points(points, voxel_size=0.1)
    assert states.dtype == np.uint8
    assert origin.dtype == np.float64
    np.testing.assert_allclose(origin, [0.0, -0.1, 0.3], atol=1e-6)
    assert states.shape == (11, 7, 1)
    assert np.count_nonzero(states == OCCUPIED) == 2
    assert np.count_nonzero(states == UNKNOWN) == states.size - 2


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), voxel_size=st.sampled_from([0.2, 0.3, 0.5]))
def test_rays_free_what_they_cross_and_hits_win(seed, voxel_size):
    rng = np.random.default_rng(seed)
    points, origins = rng.normal(size=(2, 12, 3))
    states, origin = dense_from_points(points, voxel_size=voxel_size, sensor_origins=origins)
    np.testing.assert_allclose(origin / voxel_size, np.round(origin / voxel_size), atol=1e-4)
    low = np.round(origin.astype(np.float64) / voxel_size)
    lengths = [
        crossed_by_clipping(o / voxel_size - low, p / voxel_size - low, states.shape)
        for o, p in zip(origins, points, strict=True)
    ]
    longest = np.max(lengths, axis=0)
    assert (states[longest > ROUNDING] != UNKNOWN).all()
    assert (states[longest < -ROUNDING] == UNKNOWN).all()
    hit = np.unique(np.floor(points / voxel_size).astype(int) - low.astype(int), axis=0)
    assert (states[tuple(hit.T)] == OCCUPIED).all()
    assert np.count_nonzero(states == OCCUPIED) == len(hit)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("voxel_size", [0.05, 0.1])
def test_rays_end_in_the_voxels_of_their_points_on_borders_too(axis, voxel_size):
    """Points on borders are rounded down from the frame's origin; counted from the grid's corner some go up."""
    ends = np.arange(-200, 200) / 100.0
    row, last = np.arange(len(ends)), np.floor(ends / voxel_size).astype(int)
    # One row of voxels for each ray, which comes along the axis from below all points.
    points = np.full((len(ends), 3), 0.5 * voxel_size)
    points[:, axis], points[:, axis - 1] = ends, (row + 0.5) * voxel_size
    origins = points.copy()
    origins[:, axis] = -1000.5 * voxel_size
    states, _ = dense_from_points(points, voxel_size=voxel_size, sensor_origins=origins)
    rows = np.moveaxis(states, (axis, axis - 1), (1, 0))[:, :, 0]
    end = (last + 1001)[:, None]
    step = np.arange(rows.shape[1])[None, :]
    expected = np.where(step < end, FREE, np.where(step == end, OCCUPIED, UNKNOWN))
    np.testing.assert_array_equal(rows, expected)


def test_one_origin_serves_all_points():
    points = np.asarray([[1.05, 0.05, 0.05], [0.05, 1.05, 0.05]])
    one = dense_from_points(points, voxel_size=0.1, sensor_origins=[0.05, 0.05, 0.05])
    each = dense_from_points(points, voxel_size=0.1, sensor_origins=np.full((2, 3), 0.05))
    assert np.array_equal(one[0], each[0])
    assert np.count_nonzero(one[0] == FREE) == 19


def test_rays_beyond_the_range_free_space_and_occupy_nothing():
    states, origin = dense_from_points(
        np.asarray([[5.05, 0.05, 0.05]]), voxel_size=0.1, sensor_origins=[0.05, 0.05, 0.05], max_range=2.0
    )
    assert states.shape == (21, 1, 1)
    assert (states == FREE).all()
    np.testing.assert_allclose(origin, 0.0, atol=1e-7)


def test_cloud_without_points_is_one_unknown_voxel():
    states, _ = dense_from_points(np.zeros((0, 3)), voxel_size=0.1, sensor_origins=[0.0, 0.0, 0.0])
    assert states.shape == (1, 1, 1)
    assert states[0, 0, 0] == UNKNOWN


@pytest.mark.parametrize(
    ("points", "options", "words"),
    [
        (np.zeros((4, 2)), {}, "points must have shape"),
        (np.full((4, 3), np.nan), {}, "4 of 4 rows"),
        ("cloud", {}, "points must be an array"),
        (np.asarray([[0.0, 0, 0], [1e6, 1e6, 1e6]]), {}, "larger voxel_size"),
        (np.full((1, 3), 1e11), {"voxel_size": 1e-6}, "larger voxel_size"),
        (np.full((1, 3), 1e30), {}, "within 1e.12 m"),
        (np.zeros((4, 3)), {"voxel_size": -1.0}, "voxel_size must be"),
        (np.zeros((4, 3)), {"sensor_origins": np.zeros((3, 3))}, "sensor_origins must have shape"),
        (np.zeros((4, 3)), {"sensor_origins": "here"}, "sensor_origins must be an array"),
        (np.zeros((4, 3)), {"sensor_origins": [0, 0, np.inf]}, "sensor_origins must be finite"),
        (np.zeros((4, 3)), {"sensor_origins": [0, 0, 0], "max_range": 0.0}, "max_range must be"),
        (np.zeros((4, 3)), {"max_range": 2.0}, "max_range needs sensor_origins"),
        (np.zeros((1, 3)), {"sensor_origins": [1e6, 0.0, 0.0]}, r"a ray crosses 1e\+07 voxels"),
    ],
)
def test_unusable_input_is_refused_in_one_sentence(points, options, words):
    with pytest.raises(InputError, match=words) as caught:
        dense_from_points(points, **{"voxel_size": 0.1, **options})
    assert "\n" not in str(caught.value)


def test_absurd_extent_is_refused_before_memory_is_taken():
    far = np.asarray([[0.0, 0.0, 0.0], [5e3, 5e3, 5e3]])
    with pytest.raises(InputError, match=r"1\.25e\+14 voxels"):
        VoxelGrid.from_points(far, voxel_size=0.1)


@pytest.mark.parametrize("sensor_origins", [None, [0.0, 0.0, 0.0]])
def test_a_range_is_advised_where_it_can_cut_rays(monkeypatch, sensor_origins):
    far = np.array([[0.05, 0.05, 0.05], [100.0, 100.0, 100.0]])
    monkeypatch.setenv("VOXJAX_MEMORY", "0.000001")
    for options in ({"most_dense": 1 << 40}, {"max_voxels": 1000}, {"most_dense": 1}):
        with pytest.raises(InputError) as caught:
            grid_from_points(far, voxel_size=0.5, sensor_origins=sensor_origins, **options)
        has_range = "max_range cuts rays" in str(caught.value)
        assert has_range == (sensor_origins is not None)
        assert ("--drop-isolated" in str(caught.value)) == (sensor_origins is None)


def test_the_box_of_a_cloud_with_sensors_costs_what_its_rays_cross(monkeypatch):
    rng = np.random.default_rng(0)
    cloud, origins = rng.uniform(0, 6, (2, 2000, 3))
    far = np.array([6e3, -4e3, 10.0])
    peaks = []
    for points, sensors in (
        (cloud, origins),
        (np.concatenate([cloud, cloud + far]), np.concatenate([origins, origins + far])),
    ):
        tracemalloc.start()
        grid = VoxelGrid.from_points(points, voxel_size=0.1, sensor_origins=sensors)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert grid.num_voxels > 2**31
    assert peaks[1] < 4 * peaks[0] + 100e6
    # Both halves lie on one lattice, and show the same.
    alone = VoxelGrid.from_points(cloud, voxel_size=0.1, sensor_origins=origins)
    low = np.rint((alone.origin - grid.origin) / 0.1).astype(np.int64)
    np.testing.assert_array_equal(grid.states_in(low, low + alone.shape), alone.states)
    assert grid.num_free == 2 * alone.num_free
    monkeypatch.setenv("VOXJAX_MEMORY", "0.05")
    with pytest.raises(InputError, match=r"boxes of .* voxels, in which rays are cast, needs about"):
        VoxelGrid.from_points(points, voxel_size=0.1, sensor_origins=sensors)


def test_a_ray_whose_own_box_is_too_large_is_refused():
    ends = np.array([[300.05, 200.05, 100.05]])
    with pytest.raises(InputError, match=r"the box of a ray must have at most 1,073,741,823 voxels"):
        VoxelGrid.from_points(ends, voxel_size=0.1, sensor_origins=[0.05, 0.05, 0.05])


def test_the_box_of_a_cloud_without_sensors_costs_what_is_in_it(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    cloud = np.random.default_rng(0).uniform(0, 20, (20_000, 3))
    far = np.concatenate([cloud, [[6e3, -4e3, 10.0]]])
    peaks = []
    for points in (cloud, far):
        tracemalloc.start()
        grid = VoxelGrid.from_points(points, voxel_size=0.1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert grid.is_sparse
    assert grid.num_voxels > 2**31
    assert peaks[1] < peaks[0] + 20e6
    index = np.unique(np.floor(far / 0.1).astype(np.int64), axis=0)
    np.testing.assert_array_equal(grid.occupied_index(), index - index.min(axis=0))
    monkeypatch.setenv("VOXJAX_MEMORY", "0.01")
    with pytest.raises(InputError, match=r"a grid of .* blocks of 8 x 8 x 8 voxels needs about"):
        VoxelGrid.from_points(10 * cloud, voxel_size=0.1)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_clouds_in_blocks_are_clouds_in_dense_arrays(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, rng.uniform(0.1, 3, 3), (rng.integers(1, 400), 3))
    dense, origin = grid_from_points(points, voxel_size=0.1)
    blocks, there = grid_from_points(points, voxel_size=0.1, most_dense=0)
    assert isinstance(blocks, BlockArray)
    np.testing.assert_array_equal(blocks.dense(), dense)
    np.testing.assert_array_equal(there, origin)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_rays_in_blocks_are_rays_in_dense_arrays(seed):
    rng = np.random.default_rng(seed)
    points, origins = rng.normal(0, rng.uniform(0.1, 3, 3), (2, rng.integers(1, 200), 3))
    options = {"voxel_size": 0.1, "sensor_origins": origins, "max_range": (None, 1.5)[seed % 2]}
    dense, origin = grid_from_points(points, **options)
    blocks, there = grid_from_points(points, **options, most_dense=0)
    assert isinstance(blocks, BlockArray)
    np.testing.assert_array_equal(blocks.dense(), dense)
    np.testing.assert_array_equal(there, origin)
