"""Counts and classes of maps in parts are those of one device and of the definition, also where parts meet."""

import numpy as np
import pytest

from oracles import sliding_window
from small_codes import mesh_of, small_codes
from voxjax._checks import InputError
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.large.sharded_blocks import gather_blocks, shard_blocks
from voxjax.ops.large.sharded_windows import classes_in_shards, count_in_shards

MIN_CHANGE = np.int32(20)


def _counts(occupied, devices=2, **options):
    blocks = shard_blocks(blocks_of(occupied), mesh_of(devices), value=1)
    return gather_blocks(count_in_shards(blocks, **options), blocks)


@pytest.mark.parametrize(("size", "devices"), [(1, 2), (7, 1), (7, 2), (15, 2)])
def test_counts_in_listed_blocks_equal_the_definition(size, devices):
    occupied = np.random.default_rng(size).random((41, 9, 23)) < 0.02
    counts = _counts(occupied, devices, size=size)
    assert counts.dtype == np.uint16
    expected = sliding_window.window_count(occupied, size)
    # Counts of the blocks that hold nothing are not asked for.
    x, y, z = (np.arange(n) // 8 for n in occupied.shape)
    is_listed = np.zeros((6, 2, 3), bool)
    is_listed[tuple((np.argwhere(occupied) // 8).T)] = True
    expected = np.where(is_listed[np.ix_(x, y, z)], expected, 0)
    np.testing.assert_array_equal(counts.dense(), expected)


def test_a_wall_that_crosses_the_parts_is_counted_as_if_they_were_one():
    occupied = np.zeros((64, 24, 24), bool)
    occupied[:, 8] = True
    counts = _counts(occupied)
    # Twelve blocks each: the parts meet between x = 31 and 32.
    assert set(counts.take(np.asarray([[x, 8, 12] for x in range(28, 36)]))) == {49}


@pytest.mark.parametrize(("size", "shift"), [(7, 4), (3, 6), (1, 8), (15, 1)])
def test_classes_equal_those_of_the_dense_grid(size, shift):
    given = small_codes()
    blocks = shard_blocks(given.states, mesh_of(2))
    classes = gather_blocks(classes_in_shards(blocks, MIN_CHANGE, size=size, shift=shift), blocks)
    expected = given.classes(MIN_CHANGE, size=size, shift=shift)
    np.testing.assert_array_equal(classes.dense(), expected)
    assert classes.dtype == np.uint8
    np.testing.assert_array_equal(classes.take(given.index), expected[tuple(given.index.T)])
    assert set(np.unique(expected)) == {0, 1, 2, 3}


def test_windows_that_reach_too_far_are_refused():
    blocks = shard_blocks(small_codes().states, mesh_of(2))
    with pytest.raises(InputError, match="at most 8 voxels, what a part has around its blocks, got 9"):
        classes_in_shards(blocks, MIN_CHANGE, size=7, shift=6)
    with pytest.raises(InputError, match="size"):
        count_in_shards(blocks, size=4)
    with pytest.raises(InputError, match="shift"):
        classes_in_shards(blocks, MIN_CHANGE, shift=0)
