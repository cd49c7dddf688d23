"""Changed block arrays against changed dense ones."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of
from voxjax.ops.blocks.edit import copy_blocks, with_value, zeroed_outside

SHAPES = [(17, 23, 9), (40, 8, 31), (64, 33, 64)]


def assert_is(blocks, dense):
    np.testing.assert_array_equal(blocks.dense(), dense)
    values = blocks.pool[blocks.is_uniform, 0, 0, 0]
    assert len(np.unique(values)) == len(values), "blocks of one value share a row"


@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_listed_voxels_hold_the_value_and_the_others_what_they_held(shape, value):
    dense, rng = random_boxes(shape, seed=1), np.random.default_rng(2)
    blocks = blocks_of(dense)
    index = np.stack([rng.integers(0, n, 50) for n in shape], axis=1)
    # All of one block, so that it becomes one of a single value.
    index = np.concatenate([index, np.argwhere(np.ones((8, 8, 8)))])
    expected = dense.copy()
    expected[tuple(index.T)] = value
    assert_is(with_value(blocks, index, value), expected)
    np.testing.assert_array_equal(blocks.dense(), dense)


def test_nothing_is_made_for_an_empty_list():
    blocks = blocks_of(random_boxes((17, 23, 9), seed=1))
    assert with_value(blocks, np.zeros((0, 3), int), 0) is blocks


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_values_are_kept_where_the_mask_is_not_zero(shape):
    rng = np.random.default_rng(3)
    values = rng.normal(size=shape).astype(np.float32)
    values[:8, :8] = 0.5
    mask = random_boxes(shape, seed=5)
    found = zeroed_outside(blocks_of(values), blocks_of(mask))
    assert found.dtype == np.float32
    assert_is(found, np.where(mask != 0, values, np.float32(0)))


def test_copied_blocks_lie_where_they_did():
    dense = random_boxes((40, 8, 31), seed=1)
    blocks = blocks_of(dense)
    builder = BlockBuilder(dense.shape, dense.dtype)
    copy_blocks(builder, blocks, np.argwhere(blocks.table[:3] != 0))
    dense[24:] = 0
    assert_is(builder.finish(), dense)
