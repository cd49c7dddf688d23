import numpy as np
import pytest

from voxjax import InputError
from voxjax.io.octree import subtree_ends, walk_levels


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
