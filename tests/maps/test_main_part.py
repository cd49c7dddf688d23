import numpy as np
import pytest

import voxjax as vx
from block_maps import in_blocks
from small_worlds import draw_map
from voxjax.maps.main_part import main_part


def with_stray(grid, *places):
    """The map in a box with occupied voxels at places [voxel] beyond it, and free space on the way to the first."""
    places = np.asarray(places)
    low = np.minimum(places.min(axis=0), 0)
    high = np.maximum(places.max(axis=0) + 1, grid.shape)
    states = np.zeros(high - low, np.uint8)
    x, y, z = places[0] - low
    states[min(x, -low[0]) : max(x, -low[0]), y, z] = 1
    states[tuple(slice(-a, n - a) for a, n in zip(low, grid.shape, strict=True))] = grid.states
    states[tuple((places - low).T)] = 2
    return vx.VoxelGrid(states, grid.origin + low * grid.voxel_size, grid.voxel_size)


@pytest.mark.parametrize("places", [[[900, 10, 10]], [[-700, 0, 0], [5, 800, 3], [6, 800, 3]]])
def test_strays_are_cut_off_and_nothing_else(places):
    grid = draw_map(voxel_size=0.3)
    part, count = main_part(with_stray(grid, *places))
    assert count == len(places)
    assert np.prod(part.shape) <= 27 * 3**1.5 * np.prod(grid.shape)
    np.testing.assert_allclose(part.occupied_points(), grid.occupied_points(), atol=1e-9)
    inner = np.asarray(part.states)[
        tuple((part.index_from_world(grid.world_from_index(np.argwhere(grid.states)))).T)
    ]
    np.testing.assert_array_equal(inner, np.asarray(grid.states)[np.asarray(grid.states) != 0])


def test_a_map_without_strays_is_the_same_object():
    grid = draw_map(voxel_size=0.3)
    part, count = main_part(grid)
    assert part is grid
    assert count == 0
    empty = vx.VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), 0.1)
    assert main_part(empty) == (empty, 0)


def test_a_stray_in_a_corner_of_the_wider_box_is_taken_out():
    states = np.zeros((40, 40, 40), np.uint8)
    states[:4, :4, :4] = 2
    # Farther away than the cube is wide, and inside of the box that is wider by the cube's diagonal.
    states[9, 9, 9] = 2
    part, count = main_part(vx.VoxelGrid(states, np.zeros(3), 1.0))
    assert count == 1
    assert part.num_occupied == 64
    assert part.shape == (4, 4, 4)


@pytest.mark.parametrize("has_log_odds", [False, True])
def test_strays_are_cut_off_a_map_in_blocks_as_off_a_dense_one(has_log_odds):
    # One stray far away, and one in a corner of the wider box.
    grid = with_stray(draw_map(voxel_size=0.3), [900, 10, 10], [-40, -40, -40])
    log_odds = None
    if has_log_odds:
        log_odds = np.random.default_rng(0).normal(size=grid.shape).astype(np.float32)
    grid = vx.VoxelGrid(grid.states, grid.origin, grid.voxel_size, log_odds)
    (expected, count), (found, also) = main_part(grid), main_part(in_blocks(grid))
    assert count == also == 2
    assert found.is_sparse
    assert not expected.is_sparse
    assert found.equals(expected)
    if has_log_odds:
        assert (np.asarray(found.log_odds)[np.asarray(found.states) == 0] == 0).all()
        assert np.count_nonzero(np.asarray(found.log_odds)) == np.count_nonzero(found.states)


def test_a_map_in_blocks_without_strays_is_the_same_object():
    grid = in_blocks(draw_map(voxel_size=0.3))
    assert main_part(grid)[0] is grid
