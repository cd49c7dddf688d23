import numpy as np
import pytest

from voxjax import VoxelGrid
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.view.columns import free_columns, top_columns


def random_states(seed, shape=(21, 34, 19)):
    return np.random.default_rng(seed).choice([0, 1, 2], shape, p=[0.96, 0.02, 0.02]).astype(np.uint8)


def test_the_topmost_voxel_of_each_column():
    states = random_states(0)
    index = np.argwhere(states == 2)
    color = np.repeat(index[:, 2:], 3, axis=1).astype(np.uint8)
    columns = top_columns(index, color)
    is_wall = (states == 2).any(axis=2)
    np.testing.assert_array_equal(columns.place, np.argwhere(is_wall))
    top = 18 - (states[:, :, ::-1] == 2).argmax(axis=2)
    np.testing.assert_array_equal(columns.top, top[is_wall])
    np.testing.assert_array_equal(columns.color[:, 0], top[is_wall])
    assert not len(top_columns(index[:0], color[:0]).place)


@pytest.mark.parametrize("cut", [1, 7, 8, 13, 16, 19])
def test_columns_with_something_free_below_a_height(cut):
    states = random_states(1)
    states[8:16, 8:24, 8:16] = 1
    for low, high in (((0, 0), (21, 34)), ((3, 9), (4, 10)), ((5, 8), (21, 27))):
        window = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        expected = (states[..., :cut] == 1).any(axis=2)[window]
        for kept in (states, blocks_of(states)):
            grid = VoxelGrid(kept, np.zeros(3), 0.1)
            np.testing.assert_array_equal(free_columns(grid, cut, np.array(low), np.array(high)), expected)
