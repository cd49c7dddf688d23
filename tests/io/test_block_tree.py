"""Families of a pruned tree, and the words that hold their codes; whole trees are in `test_octomap.py`."""

import numpy as np

from voxjax.io.block_tree import families, words_of
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of


def test_words_have_two_bits_for_each_code():
    code = np.random.default_rng(0).integers(0, 4, (200, 8)).astype(np.uint8)
    expected = (code.astype(np.int64) << np.arange(0, 16, 2)).sum(axis=1)
    assert words_of(code).tolist() == expected.tolist()


def test_eight_equal_leaves_become_one():
    states = np.full((2, 2, 2), 2, np.uint8)
    found = list(families(blocks_of(states), None, np.array([4, 4, 4])))
    # The cube is a leaf of level 15, so that no voxel is left for level 16.
    assert [len(some.parent) for some in found] == [0, *[1] * 15]
    assert found[1].depth == 14
    assert found[1].code.tolist() == [[2, 0, 0, 0, 0, 0, 0, 0]]
    states[1, 0, 0] = 1
    found = list(families(blocks_of(states), None, np.array([4, 4, 4])))
    assert found[0].depth == 15
    assert found[0].code.tolist() == [[2, 1, 2, 2, 2, 2, 2, 2]]
    assert found[1].code.tolist() == [[3, 0, 0, 0, 0, 0, 0, 0]]


def test_wide_space_of_one_value_is_few_families():
    builder = BlockBuilder((1024, 1024, 1024), np.uint8)
    builder.put_boxes(np.zeros((1, 3), np.int64), (128, 128, 128), np.array([1], np.uint8))
    found = list(families(builder.finish(), None, np.array([32768, 32768, 32768])))
    # One leaf of level 6, and the inner nodes above it.
    assert sum(len(some.parent) for some in found) == 6


def test_inner_nodes_have_the_highest_log_odds_below_them():
    states = np.array([[[2, 1]]], np.uint8)
    odds = np.array([[[0.5, -0.25]]], np.float32)
    found = list(families(blocks_of(states), blocks_of(odds), np.array([0, 0, 0])))
    assert found[0].value is not None
    assert found[0].value[0, [0, 4]].tolist() == [0.5, -0.25]
    assert all(some.value is not None and some.value[0, 0] == 0.5 for some in found[1:])
