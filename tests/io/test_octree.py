import numpy as np
import pytest

from voxjax import InputError
from voxjax.io.octree import pre_order, prune, subtree_ends, walk_levels


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
    child_mask = np.array([1 << 1 | 1 << 6, 0, 0], np.uint8)
    (root, root_key), (records, keys) = walk_levels(child_mask)
    assert root.tolist() == [0]
    assert root_key.tolist() == [[0, 0, 0]]
    assert records.tolist() == [1, 2]
    assert keys.tolist() == [[32768, 0, 0], [0, 32768, 32768]]


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
