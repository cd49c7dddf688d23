import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occupied_grids import walls
from oracles import sliding_window
from voxjax.ops.blocks import choice as block_choice
from voxjax.ops.blocks.choice import box_count_at
from voxjax.ops.window.classes import box_count


@pytest.mark.parametrize("implementation", ["dense", "blocks", None])
@pytest.mark.parametrize("size", [3, 7])
def test_counts_at_voxels_equal_the_dense_ones_also_beside_empty_blocks(implementation, size):
    occupied = walls()
    rng = np.random.default_rng(1)
    anywhere = rng.integers(0, occupied.shape, (200, 3))
    index = np.concatenate([np.argwhere(occupied), anywhere, anywhere]).astype(np.int32)
    expected = sliding_window.window_count(occupied, size)[tuple(index.T)]
    for grid in (occupied, jnp.asarray(occupied)):
        counts = box_count_at(grid, index, size=size, implementation=implementation)
        assert counts.dtype == jnp.uint16
        np.testing.assert_array_equal(np.asarray(counts), expected)


@pytest.mark.parametrize(("share", "calls"), [(0.0, 1), (1.0, 0)])
def test_the_share_of_blocks_decides_whether_the_whole_grid_is_counted(monkeypatch, share, calls):
    whole = []
    dense = block_choice._dense_at
    monkeypatch.setattr(block_choice, "MAX_BLOCK_SHARE", share)
    monkeypatch.setattr(block_choice, "MIN_VOXELS", 1)
    monkeypatch.setattr(block_choice, "_dense_at", lambda *a, **k: whole.append(a) or dense(*a, **k))
    occupied = walls()
    box_count_at(occupied, np.argwhere(occupied).astype(np.int32))
    assert len(whole) == calls
    monkeypatch.setattr(block_choice, "MIN_VOXELS", occupied.size + 1)
    box_count_at(occupied, np.argwhere(occupied).astype(np.int32))
    assert len(whole) == calls + 1


def test_counts_at_voxels_work_under_jit():
    occupied = jnp.asarray(walls())
    index = jnp.asarray(np.argwhere(walls()).astype(np.int32))
    expected = box_count(occupied)[tuple(index.T)]
    np.testing.assert_array_equal(np.asarray(jax.jit(box_count_at)(occupied, index)), np.asarray(expected))


def test_counts_at_no_voxels_are_none():
    assert box_count_at(walls(), np.zeros((0, 3), np.int32)).shape == (0,)
