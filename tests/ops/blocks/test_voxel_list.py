import numpy as np
import pytest

from voxjax.ops.blocks.voxel_list import blocks_with, count_blocks


@pytest.mark.parametrize("shape", [(1, 1, 1), (8, 16, 8), (37, 5, 90)])
def test_a_list_of_voxels_in_blocks_is_the_list_in_a_dense_array(shape):
    rng = np.random.default_rng(0)
    index = np.stack([rng.integers(0, n, 300) for n in shape], axis=1)
    blocks = blocks_with(index, np.uint8(2), shape)
    dense = np.zeros(shape, np.uint8)
    dense[tuple(index.T)] = 2
    np.testing.assert_array_equal(blocks.dense(), dense)
    assert count_blocks(index) == len(np.unique(index >> 3, axis=0))
    # A block that is full shares its row with all others of its kind.
    assert len(np.unique(blocks.pool[blocks.is_uniform, 0, 0, 0])) == np.count_nonzero(blocks.is_uniform)


def test_a_list_may_be_longer_than_what_is_made_at_a_time():
    index = 8 * np.argwhere(np.ones((30, 30, 30)))
    blocks = blocks_with(index, np.float32(-1.5), (240, 240, 240))
    np.testing.assert_array_equal(blocks.where(-1.5), index)
