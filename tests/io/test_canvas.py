import numpy as np
import pytest

from voxjax.io.canvas import canvas_for, cells_of
from voxjax.io.leaves import NUM_KEYS, Leaves, leaf_map
from voxjax.ops.resampling.rescale import rescale_states


def two_leaves():
    """A leaf four voxels wide and a voxel beside it, near the origin of the frame."""
    wide = Leaves(14, np.full((1, 3), NUM_KEYS // 2 + 4, np.int32), np.array([1], np.uint8))
    voxel = Leaves(16, np.full((1, 3), NUM_KEYS // 2 + 9, np.int32), np.array([2], np.uint8))
    return leaf_map([wide, voxel], 0.1, has_log_odds=False)


@pytest.mark.parametrize("voxel_size", [0.1, 0.25, 0.3, 0.05, 0.07])
def test_the_grid_is_that_of_all_voxels_brought_to_its_voxel_size(voxel_size):
    leaves = two_leaves()
    origin = (leaves.low - NUM_KEYS // 2) * leaves.resolution
    states, there, _ = rescale_states(np.ones(leaves.shape, np.uint8), origin, 0.1, voxel_size)
    canvas = canvas_for(leaves, voxel_size)
    assert canvas.shape == states.shape
    np.testing.assert_allclose(canvas.origin, there, atol=1e-12)
    assert (canvas.is_own, canvas.is_shared) == (voxel_size == 0.1, voxel_size > 0.1)


def test_leaves_fill_the_cells_that_hold_centres():
    leaves = two_leaves()
    # Cells of 0.25 m: voxel centres from 0.45 to 0.75 m lie in cells 1 to 3, counted from the frame's origin.
    first, size = cells_of(leaves, canvas_for(leaves, 0.25), leaves.levels[0])
    assert [int(along[0]) for along in first] == [0, 0, 0]
    assert [int(along[0]) for along in size] == [3, 3, 3]
    first, size = cells_of(leaves, canvas_for(leaves, 0.25), leaves.levels[1])
    assert [int(along[0]) for along in first] == [2, 2, 2]
    assert [int(along[0]) for along in size] == [1, 1, 1]
    first, size = cells_of(leaves, canvas_for(leaves, 0.05), leaves.levels[1])
    assert [int(along[0]) for along in first] == [10, 10, 10]
    assert [int(along[0]) for along in size] == [2, 2, 2]
