"""Mirror images of prepared maps, and prepared maps in another unit of length."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax import VoxelGrid
from voxjax.maps.mirrored import mirrored, mirrored_grid, scaled
from voxjax.maps.prepared import prepare_map
from voxjax.ops.evidence.nearest import split_keys

LISTS = ("points", "anchors", "normals", "sides", "weights", "planarity")
POOLS = ("states", "codes", "rough_codes")


@pytest.fixture(scope="module")
def grid():
    return draw_map(pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0)), voxel_size=0.2)


@pytest.fixture(scope="module")
def prepared(grid):
    return prepare_map(grid)


def cells_of(prepared, name):
    """Values of a pool by blocks of the box, in C order."""
    rows = np.asarray(prepared.table)[: prepared.num_blocks]
    return np.asarray(getattr(prepared, name)).reshape(-1, 512)[rows]


def test_the_mirror_image_of_a_grid_has_each_voxel_at_minus_x(grid):
    image = mirrored_grid(grid)
    for states in (1, 2):
        here = grid.world_from_index(np.argwhere(np.asarray(grid.states) == states)) * [-1.0, 1.0, 1.0]
        there = image.world_from_index(np.argwhere(np.asarray(image.states) == states))
        here, there = (points[np.lexsort(np.rint(points.T / 0.01))] for points in (here, there))
        np.testing.assert_allclose(there, here, atol=1e-9)


def test_a_mirrored_map_is_the_map_that_was_mirrored_before_it_was_prepared(grid, prepared):
    found = mirrored(prepared)
    expected = prepare_map(mirrored_grid(grid))
    # The image of what is cut to the known begins with up to seven unknown layers more.
    assert found.grid.crop_to_known().equals(expected.grid)
    assert not found.grid.equals(prepared.grid)
    count = expected.num_points
    assert found.num_points == count
    for name in LISTS:
        one, other = (np.asarray(getattr(each, name)) for each in (found, expected))
        if name in ("normals", "sides"):
            # A surface has no sign of its own where as much is free on one side as on the other.
            is_turned = np.sum(one * other, axis=1, keepdims=True) < 0
            assert is_turned[:count].mean() < (0.02 if name == "normals" else 1e-3)
            other = np.where(is_turned, -other, other)
        np.testing.assert_allclose(one[:count], other[:count], atol=2e-3, err_msg=name)
        assert not one[count:].any()


def test_pools_of_a_mirrored_map_hold_the_same_in_reverse(prepared):
    found = mirrored(prepared)
    lattice = tuple(-(-side // 8) for side in prepared.grid.shape)
    for name in POOLS:
        here, there = (cells_of(each, name).reshape(*lattice, 8, 8, 8) for each in (prepared, found))
        np.testing.assert_array_equal(there[::-1, :, :, ::-1], here, err_msg=name)


def test_keys_of_a_mirrored_map_point_to_the_image_of_the_nearest_voxel(prepared):
    found = mirrored(prepared)
    points = np.asarray(prepared.points)
    lattice = tuple(-(-side // 8) for side in prepared.grid.shape)
    row, squared = (np.asarray(part) for part in split_keys(cells_of(prepared, "keys")))
    image_row, image_squared = (
        np.asarray(part).reshape(*lattice, 8, 8, 8)[::-1, :, :, ::-1].reshape(-1, 512)
        for part in split_keys(cells_of(found, "keys"))
    )
    np.testing.assert_array_equal(image_squared, squared)
    is_near = squared < 63
    assert is_near.any()
    image = np.asarray(found.points)[image_row[is_near]] * np.asarray([-1.0, 1.0, 1.0], np.float32)
    np.testing.assert_allclose(image, points[row[is_near]], atol=1e-6)


def test_blocks_with_a_row_of_their_own_stand_in_the_order_of_their_box(prepared):
    found = mirrored(prepared)
    own = np.asarray(found.table)[: found.num_blocks]
    own = own[own >= found.num_shared]
    np.testing.assert_array_equal(own, np.arange(found.num_shared, found.num_rows))


def test_a_scaled_map_is_the_map_that_was_scaled_before_it_was_prepared(grid, prepared):
    found = scaled(prepared, 1.1)
    expected = prepare_map(VoxelGrid(grid.states, np.asarray(grid.origin) * 1.1, grid.voxel_size * 1.1))
    assert found.grid.equals(expected.grid)
    for name in (*LISTS, "centroid"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-5, err_msg=name)
    for name in POOLS:
        np.testing.assert_array_equal(cells_of(found, name), cells_of(expected, name))
