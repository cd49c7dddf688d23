import numpy as np
import pytest

from voxjax import InputError
from voxjax.io.octree import Leaves, bounding_box, paint, pre_order, prune, subtree_ends, walk_levels


def test_subtrees_end_where_the_next_sibling_begins():
    #                 root 0: children 1 (with 2 and 3) and 4 (with 5)
    ends = subtree_ends(np.array([2, 2, 0, 0, 1, 0]))
    assert ends.tolist() == [6, 4, 3, 4, 6, 6]


@pytest.mark.parametrize(
    ("num_children", "sentence"),
    [
        ([2, 0], "truncated"),
        ([1, 0, 0], "trailing"),
        ([8] * 17 + [0] * 120, "deeper than 16"),
    ],
)
def test_lists_that_are_no_tree_are_refused(num_children, sentence):
    with pytest.raises(InputError, match=sentence):
        subtree_ends(np.array(num_children))


def test_levels_know_the_lowest_voxel_of_each_record():
    has_record = np.zeros((3, 8), bool)
    has_record[0, [1, 6]] = True
    (root, root_key), (records, keys) = walk_levels(has_record)
    assert root.tolist() == [0]
    assert root_key.tolist() == [[0, 0, 0]]
    assert records.tolist() == [1, 2]
    assert keys.tolist() == [[32768, 0, 0], [0, 32768, 32768]]


@pytest.mark.parametrize("depth", [11, 12, 14, 15, 16])
def test_leaves_of_any_width_fill_their_voxels(depth):
    width = 1 << (16 - depth)
    key = np.array([[0, 0, 0], [width, 0, width]], np.int32) + np.int32(64)
    leaves = [Leaves(depth, key, np.array([1, 2], np.uint8))]
    low, shape = bounding_box(leaves)
    assert low.tolist() == [64, 64, 64]
    assert shape.tolist() == [2 * width, width, 2 * width]
    dense = paint(leaves, low, tuple(shape.tolist()), np.uint8)
    assert (dense[:width, :, :width] == 1).all()
    assert (dense[width:, :, width:] == 2).all()
    assert np.count_nonzero(dense) == 2 * width**3


def test_leaves_beyond_one_piece_are_painted_too():
    states = np.random.default_rng(0).integers(1, 3, (50, 50, 50)).astype(np.uint8)
    key = np.argwhere(states).astype(np.int32)
    assert len(key) > 1 << 16
    dense = paint([Leaves(16, key, states[tuple(key.T)])], np.zeros(3, np.int64), states.shape, np.uint8)
    np.testing.assert_array_equal(dense, states)


def test_eight_equal_voxels_become_one_leaf():
    voxels, parents = prune(np.full((2, 2, 2), 2, np.uint8), None, np.array([4, 4, 4]))[:-3:-1]
    assert (voxels.code == 2).all()
    assert parents.low.tolist() == [2, 2, 2]
    assert parents.code[0, 0, 0] == 2
    split = prune(np.array([[[1, 2]]], np.uint8), None, np.array([4, 4, 4]))
    assert split[-2].code[0, 0, 0] == 3


def test_pre_order_puts_parents_before_children_and_children_by_number():
    key = np.array([[1, 0, 0], [0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, 0]])
    assert pre_order(key, np.array([16, 16, 16, 16, 15])).tolist() == [4, 1, 0, 3, 2]
