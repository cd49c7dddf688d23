"""Free space inferred from what encloses it, against what the sensor of a small building saw."""

import numpy as np
import pytest

import small_worlds
from voxjax import VoxelGrid, register
from voxjax.maps import inferred_space, prepared
from voxjax.maps.inferred_space import infer_free_space
from voxjax.metrics import pose_error
from voxjax.ops.surface.enclosure import is_enclosed
from voxjax.registration.hypotheses.map_features import map_features

FRAME = small_worlds.pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))


def stripped(grid):
    states = np.asarray(grid.states)
    return VoxelGrid(np.where(states == 1, np.uint8(0), states), grid.origin, grid.voxel_size)


@pytest.mark.parametrize("frame", [None, FRAME])
def test_most_of_what_is_inferred_was_free_and_most_of_what_was_free_is_inferred(frame):
    grid = small_worlds.draw_map(frame)
    states, inferred = np.asarray(grid.states), np.asarray(infer_free_space(stripped(grid)).states)
    is_inferred = inferred == 1
    assert (states[is_inferred] == 1).mean() > 0.9
    assert is_inferred[states == 1].mean() > 0.6
    np.testing.assert_array_equal(inferred == 2, states == 2)


def test_short_rays_and_many_directions_infer_less():
    grid = stripped(small_worlds.draw_map())
    usual = infer_free_space(grid).num_free
    assert infer_free_space(grid, reach=1.0).num_free < usual
    assert infer_free_space(grid, min_directions=26).num_free < usual


def test_what_is_known_stays():
    grid = small_worlds.draw_map()
    known = np.asarray(grid.states) != 0
    np.testing.assert_array_equal(
        np.asarray(infer_free_space(grid).states)[known], np.asarray(grid.states)[known]
    )


def test_nothing_is_inferred_before_a_single_wall():
    states = np.zeros((40, 40, 40), np.uint8)
    states[20, 5:35, 5:35] = 2
    grid = VoxelGrid(states, np.zeros(3, np.float32), 0.1)
    assert infer_free_space(grid).num_free == 0
    assert map_features(grid, max_virtual=8).free_space == "unknown"


def test_odd_shapes_keep_their_shape():
    states = np.zeros((7, 5, 9), np.uint8)
    states[0], states[-1] = 2, 2
    grid = VoxelGrid(states, np.asarray([1.0, 2.0, 3.0], np.float32), 0.1)
    inferred = infer_free_space(grid)
    assert np.asarray(inferred.states).shape == (7, 5, 9)
    np.testing.assert_array_equal(inferred.origin, grid.origin)


@pytest.mark.parametrize("slab", [1, 100, 1 << 18])
@pytest.mark.parametrize("shape", [(9, 14, 11), (8, 8, 8), (21, 3, 13)])
def test_voxels_are_freed_by_cells_of_two_whatever_the_slabs(shape, slab, monkeypatch):
    monkeypatch.setattr(inferred_space, "_SLAB", slab)
    states = np.random.default_rng(sum(shape)).choice(
        np.asarray([0, 1, 2], np.uint8), shape, p=[0.9, 0.05, 0.05]
    )
    cells = np.zeros([-(-n // 2) for n in shape], bool)
    for place in np.argwhere(states == 2):
        cells[tuple(place // 2)] = True
    enclosed = is_enclosed(cells, reach=4.0, min_directions=5)
    expected = states.copy()
    for place in np.argwhere(states == 0):
        if enclosed[tuple(place // 2)]:
            expected[tuple(place)] = 1
    assert (expected != states).any()
    grid = VoxelGrid(states, np.zeros(3, np.float32), 0.5)
    np.testing.assert_array_equal(infer_free_space(grid, reach=4.0, min_directions=5).states, expected)
    np.testing.assert_array_equal(grid.states, states)


def test_a_map_without_voxels_is_no_error():
    empty = VoxelGrid(np.zeros((0, 3, 3), np.uint8), np.zeros(3, np.float32), 0.1)
    assert infer_free_space(empty).shape == (0, 3, 3)


def test_a_cloud_is_registered_with_inferred_free_space_and_says_so():
    a, b = small_worlds.draw_map(), small_worlds.draw_map(FRAME)
    truth, centroid = np.linalg.inv(FRAME), b.occupied_points().mean(axis=0)
    found = register(stripped(a), stripped(b))
    assert found.stats["free_space"] == "inferred"
    assert found.accepted
    assert "inferred" in found.reason
    assert pose_error(found.T_a_b, truth, centroid).degrees < 1.0
    assert register(a, stripped(b)).stats["free_space"] == "inferred"
    assert register(a, b).stats["free_space"] == "observed"
    off = register(stripped(a), stripped(b), config={"map": {"infer_free_space": False}})
    assert off.stats["free_space"] == "unknown"
    assert "unknown" in off.reason


def test_half_a_scan_gets_too_little_and_stays_as_it_is(monkeypatch):
    grid = stripped(small_worlds.draw_map())
    states = np.asarray(grid.states).copy()
    states[:, :, 6:] = 0  # the floor and, of a third of the building, the feet of the walls
    states[20:, :, 2:] = 0
    half = VoxelGrid(states, grid.origin, grid.voxel_size)
    assert infer_free_space(half).num_free > 0
    made = []
    table = prepared.map_pools
    monkeypatch.setattr(prepared, "map_pools", lambda *a, **k: made.append(a) or table(*a, **k))
    features = map_features(half, max_virtual=8)
    assert features.free_space == "unknown"
    assert features.prepared.grid.num_free == 0
    assert len(made) == 1, "fields are made of the map that is used alone"
    assert map_features(grid, max_virtual=8).free_space == "inferred"
