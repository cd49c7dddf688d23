"""Free space inferred in blocks against that inferred in dense arrays."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from block_maps import far_apart, in_blocks, peak_of, turned_map
from voxjax import VoxelGrid
from voxjax.maps.inferred_blocks import infer_in_blocks
from voxjax.maps.inferred_space import infer_free_space
from voxjax.ops.blocks.block_builder import blocks_of


def stripped(grid):
    states = np.asarray(grid.states)
    return VoxelGrid(np.where(states == 1, np.uint8(0), states), grid.origin, grid.voxel_size)


@pytest.mark.parametrize(("reach", "directions"), [(30.0, 20), (4.5, 5), (1.0, 1), (0.5, 1)])
@pytest.mark.parametrize("shape", [(173, 134, 112), (9, 14, 130), (1, 90, 70)], ids=str)
def test_states_are_those_of_the_dense_way_whatever_the_tiles(shape, reach, directions):
    states = random_boxes(shape, seed=sum(shape), share=0.01)
    # Some free space is known and some is not.
    states[(states == 1) & (np.random.default_rng(0).random(shape) < 0.5)] = 0
    grid = VoxelGrid(states, np.zeros(3), 0.5)
    expected = infer_free_space(grid, reach=reach, min_directions=directions)
    for most in (1 << 18, 1 << 24):
        found = infer_in_blocks(blocks_of(states), reach=reach, min_directions=directions, most=most)
        np.testing.assert_array_equal(found.dense(), expected.states)
        values = found.pool[found.is_uniform, 0, 0, 0]
        assert len(np.unique(values)) == len(values), "blocks of one value share a row"


def test_a_building_in_blocks_gets_the_free_space_of_the_dense_one():
    grid = stripped(turned_map())
    expected, found = infer_free_space(grid), infer_free_space(in_blocks(grid))
    assert expected.num_free > grid.num_occupied
    assert found.is_sparse
    assert not expected.is_sparse
    assert found.equals(expected)


def test_memory_follows_what_is_there_and_not_the_box():
    room = stripped(turned_map())
    grid = far_apart(room)
    found, peak = peak_of(lambda: infer_free_space(grid, reach=3.0))
    assert found.num_free == 2 * infer_free_space(room, reach=3.0).num_free > 0
    assert peak < 100e6 < grid.num_voxels / 40
