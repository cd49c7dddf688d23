"""`BlockBuilder`: rows of a pool from blocks, boxes and single values."""

import numpy as np
import pytest

from voxjax import InputError
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of


def check_invariants(blocks: BlockArray):
    assert not blocks.pool[0].any()
    values = blocks.pool[blocks.is_uniform, 0, 0, 0]
    assert len(np.unique(values)) == len(values)


def test_log_odds_of_one_value_share_a_block():
    dense = np.zeros((32, 32, 32), np.float32)
    dense[:16] = -0.4
    dense[20, 20, 20] = 3.5
    blocks = blocks_of(dense)
    check_invariants(blocks)
    assert len(blocks.pool) == 3
    np.testing.assert_array_equal(blocks.dense(), dense)


def test_blocks_of_one_value_end_where_the_box_ends():
    builder = BlockBuilder((12, 12, 12), np.uint8)
    builder.put(np.array([[0, 0, 0], [1, 0, 1]]), np.array([1, 2], np.uint8))
    blocks = builder.finish()
    check_invariants(blocks)
    expected = np.zeros((12, 12, 12), np.uint8)
    expected[:8, :8, :8] = 1
    expected[8:, :8, 8:] = 2
    np.testing.assert_array_equal(blocks.dense(), expected)
    assert blocks.count(2) == 4 * 8 * 4


def test_what_lies_beyond_the_box_becomes_zero_and_the_caller_s_blocks_stay():
    given = np.ones((1, 8, 8, 8), np.uint8)
    builder = BlockBuilder((5, 8, 3), np.uint8)
    builder.add(np.array([[0, 0, 0]]), given)
    blocks = builder.finish()
    assert given.all()
    assert blocks.count(1) == 5 * 8 * 3
    np.testing.assert_array_equal(blocks.dense(), np.ones((5, 8, 3), np.uint8))


def test_a_table_that_int32_does_not_count_is_refused():
    with pytest.raises(InputError, match="crop the map, or take a larger voxel size"):
        BlockBuilder((65_536, 65_536, 65_536), np.uint8)


def test_boxes_of_blocks_of_one_value_are_put_at_once():
    builder = BlockBuilder((64, 64, 60), np.float32)
    builder.put_boxes(np.array([[0, 0, 0], [4, 1, 3]]), (3, 2, 2), np.array([1.5, -2.0], np.float32))
    places = np.array([[2, 1, 1], [6, 2, 4], [3, 0, 0]])
    assert builder.levels_at(places).tolist() == [1.5, -2.0, 0.0]
    blocks = builder.finish()
    check_invariants(blocks)
    expected = np.zeros((64, 64, 60), np.float32)
    expected[:24, :16, :16], expected[32:56, 8:24, 24:40] = 1.5, -2.0
    np.testing.assert_array_equal(blocks.dense(), expected)


@pytest.mark.parametrize("capacity", [0, 2, 5, 100])
def test_a_builder_takes_more_blocks_than_it_was_told_of(capacity):
    rng = np.random.default_rng(0)
    dense = rng.integers(0, 3, (16, 24, 8)).astype(np.uint8)
    dense[:8, :8] = 1
    builder = BlockBuilder(dense.shape, np.uint8, capacity=capacity)
    for index in np.ndindex(2, 3, 1):
        x, y, z = (8 * n for n in index)
        builder.add(np.array([index]), dense[None, x : x + 8, y : y + 8, z : z + 8])
    blocks = builder.finish()
    check_invariants(blocks)
    assert len(blocks.pool) == 7
    np.testing.assert_array_equal(blocks.dense(), dense)
