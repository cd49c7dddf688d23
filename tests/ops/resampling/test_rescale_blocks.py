"""Change of resolution in blocks gives the bits of the dense way."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax import InputError, VoxelGrid
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.rescale import rescale_states
from voxjax.ops.resampling.rescale_blocks import rescale_blocks

ORIGIN = np.array([-0.4, 0.83, 1.2])


def make_values(seed, shape):
    """States, and log-odds that are not 0 everywhere where nothing is known."""
    states = random_boxes(shape, seed=seed, num_boxes=8)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    odd = np.random.default_rng(seed).random(shape) < 0.01
    log_odds[odd] = np.random.default_rng(seed).normal(size=int(odd.sum()))
    return states, log_odds


@pytest.mark.parametrize("new_size", [0.1, 0.13, 0.2, 0.47, 0.8, 3.0, 0.05, 0.033])
@pytest.mark.parametrize("seed", range(2))
def test_blocks_give_the_bits_of_the_dense_way(new_size, seed):
    states, log_odds = make_values(seed, (43, 30, 21) if seed else (9, 64, 17))
    expected = rescale_states(states, ORIGIN, 0.1, new_size, log_odds)
    found = rescale_blocks(blocks_of(states), ORIGIN, 0.1, new_size, blocks_of(log_odds))
    np.testing.assert_array_equal(found[1], expected[1])
    for blocks, dense in ((found[0], expected[0]), (found[2], expected[2])):
        assert blocks is not None
        assert dense is not None
        np.testing.assert_array_equal(blocks.dense(), dense)
        assert blocks.equals(blocks_of(dense))
    without = rescale_blocks(blocks_of(states), ORIGIN, 0.1, new_size)
    assert without[0].equals(found[0])
    assert without[2] is None


@pytest.mark.parametrize("ratio", [0.01, 0.31, 1.0, 1.7])
def test_tiles_and_windows_that_cut_through_cells_change_nothing(ratio):
    """Long enough for windows to end within a tile, and cells within a window; tiles of 64 voxels a side."""
    states, log_odds = make_values(4, (700, 40, 9))
    args = np.array([0.03, -0.7, 0.15]), 0.1, 0.1 / ratio
    dense = rescale_states(states, *args, log_odds)
    for most in (1 << 22, 1):
        found = rescale_blocks(blocks_of(states), *args, blocks_of(log_odds), most=most)
        np.testing.assert_array_equal(found[0].dense(), dense[0])
        assert found[2] is not None
        np.testing.assert_array_equal(found[2].dense(), dense[2])


def test_a_sparse_map_stays_sparse_in_a_box_of_any_size():
    states = random_boxes((40, 33, 20), seed=1)
    blocks = blocks_of(states)
    table = np.zeros((512, 512, 128), np.int32)
    table[304:309, 16:21, 88:91] = blocks.table
    huge = VoxelGrid(BlockArray(table, blocks.pool, (4096, 4096, 1024)), np.zeros(3), 0.1)
    coarse = huge.with_voxel_size(0.4)
    assert coarse.is_sparse
    assert coarse.shape == (1024, 1024, 256)
    alone = VoxelGrid(states, np.zeros(3), 0.1).with_voxel_size(0.4)
    low = 2 * np.array([304, 16, 88])
    np.testing.assert_array_equal(coarse.states_in(low, low + alone.shape), alone.states)
    assert coarse.num_occupied == alone.num_occupied
    with pytest.raises(InputError, match="larger voxel size"):
        huge.with_voxel_size(0.0001)
