"""Painted leaves, against all their voxels painted one leaf after the other and brought to another voxel size."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dense_paint
from oracles import octree as oracle
from voxjax import InputError, VoxelGrid
from voxjax.io import leaf_parts
from voxjax.io import paint as paint_module
from voxjax.io.canvas import canvas_for
from voxjax.io.crop import crop_grid
from voxjax.io.leaf_parts import cut_leaves
from voxjax.io.leaves import Leaves, leaf_map
from voxjax.io.octomap import decode_bt, decode_ot, encode_bt, encode_ot
from voxjax.io.paint import paint

RATIOS = (1, 2, 2.5, 3, 0.5, 1.7, 13)


def random_file(seed):
    """A file whose leaves are up to 16 voxels wide, and how it is read."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(8, 36, 3))
    coarse = [-(-side // 8) for side in shape]

    def voxels(values):
        return values.repeat(8, 0).repeat(8, 1).repeat(8, 2)[: shape[0], : shape[1], : shape[2]].copy()

    states = voxels(rng.choice(3, coarse, p=[0.4, 0.3, 0.3]).astype(np.uint8))
    flips = rng.random(shape) < rng.choice([0.0, 0.02, 0.2])
    states[flips] = rng.integers(0, 3, flips.sum())
    states[tuple(rng.integers(0, shape))] = 2
    size = float(rng.choice([0.05, 0.1, 0.137]))
    odds = None
    if rng.random() < 0.5:
        values = voxels(rng.integers(0, 3, coarse).astype(np.float32)) + np.float32(0.25)
        odds = np.where(states == 2, values, np.where(states == 1, -values, np.float32(0)))
    grid = VoxelGrid(states, rng.integers(-5, 5, 3) * 8 * size, size, odds)
    return (encode_bt(grid), decode_bt, rng) if odds is None else (encode_ot(grid), decode_ot, rng)


def painted(leaves, voxel_size):
    canvas = canvas_for(leaves, voxel_size)
    return paint(cut_leaves(leaves, canvas), canvas)


def random_leaves(rng, *, has_log_odds):
    """Leaves of up to 64 voxels, none inside of another, anywhere between the keys; cut by a window now and then."""
    levels = {depth: [] for depth in range(10, 17)}
    corner = rng.integers(0, 700, 3) * 64

    def grow(key, depth):
        width = 1 << (16 - depth)
        if depth == 16 or (depth >= 10 and rng.random() < 0.4):
            if rng.random() < 0.6:
                levels[depth].append(key)
            return
        for child in np.ndindex(2, 2, 2):
            if rng.random() < 0.25:
                grow(key + np.array(child) * width // 2, depth + 1)

    for root in np.ndindex(2, 1, 1):
        grow(corner + np.array(root) * 64, 10)
    levels[16].append(corner + np.array([3, 1, 90]))
    made = []
    for depth, keys in levels.items():
        states = rng.integers(1, 3, len(keys)).astype(np.uint8)
        odds = np.where(states == 2, 1, -1) * rng.choice([0.25, 0.5, 3.5], len(keys))
        value = odds.astype(np.float32) if has_log_odds else states
        made.append(Leaves(depth, np.array(keys, np.int32).reshape(-1, 3), value))
    leaves = leaf_map(made, 0.1, has_log_odds=has_log_odds)
    if rng.random() < 0.5:
        inner = leaves.cut(leaves.low + rng.integers(0, 20, 3), leaves.high - rng.integers(0, 20, 3))
        leaves = inner if inner.levels else leaves
    return leaves


@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
@settings(max_examples=30, deadline=None)
def test_leaves_are_painted_as_into_a_dense_array(seed, has_log_odds, is_small):
    rng = np.random.default_rng(seed)
    leaves = random_leaves(rng, has_log_odds=has_log_odds)
    with pytest.MonkeyPatch.context() as patch:
        # Blocks in the order in which they are seen, and some at a time, as those of large boxes are.
        if not is_small:
            patch.setattr(leaf_parts, "FEW_BLOCKS", 0)
            patch.setattr(paint_module, "BLOCKS_AT_ONCE", 20)
        for ratio in rng.choice(RATIOS, 3, replace=False).tolist():
            got = painted(leaves, ratio * leaves.resolution)
            for blocks, dense in zip(
                got, dense_paint.painted(leaves, ratio * leaves.resolution), strict=True
            ):
                assert (blocks is None) == (dense is None)
                if blocks is not None:
                    np.testing.assert_array_equal(blocks.dense(), dense)
                    values = blocks.pool[blocks.is_uniform, 0, 0, 0]
                    assert len(np.unique(values)) == len(values)


def assert_same(got, expected):
    assert got.voxel_size == expected.voxel_size
    # Origins of one place may differ by the rounding of a sum.
    np.testing.assert_allclose(got.origin, expected.origin, atol=1e-4 * got.voxel_size)
    np.testing.assert_array_equal(got.states, expected.states)
    assert (got.log_odds is None) == (expected.log_odds is None)
    if got.log_odds is not None:
        np.testing.assert_array_equal(got.log_odds, expected.log_odds)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_leaves_at_any_voxel_size_are_all_voxels_brought_there(seed):
    data, decode, _ = random_file(seed)
    whole = decode(data)
    for ratio in RATIOS:
        size = ratio * whole.voxel_size
        assert_same(decode(data, voxel_size=size), whole.with_voxel_size(size))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_cropped_leaves_are_all_voxels_cropped(seed):
    data, decode, rng = random_file(seed)
    whole = decode(data)
    low, high = whole.extent
    for ratio in RATIOS:
        crop = np.sort(rng.uniform(low - 0.3, high + 0.3, (2, 3)), axis=0)
        size = ratio * whole.voxel_size
        try:
            cut = crop_grid(whole, crop)
        except InputError:
            with pytest.raises(InputError, match="knows nothing in the crop"):
                decode(data, crop=crop)
            continue
        assert_same(decode(data, crop=crop), cut)
        assert_same(decode(data, crop=crop, voxel_size=size), cut.with_voxel_size(size))


@pytest.mark.parametrize("depth", [9, 12, 14, 15, 16])
def test_leaves_of_any_width_fill_their_voxels(depth):
    width = 1 << (16 - depth)
    key = np.array([[0, 0, 0], [width, 0, width]], np.int32) + np.int32(128)
    leaves = leaf_map([Leaves(depth, key, np.array([1, 2], np.uint8))], 0.1, has_log_odds=False)
    blocks, log_odds = painted(leaves, 0.1)
    assert log_odds is None
    # Nothing but the two values and the unknown.
    assert len(blocks.pool) <= 3
    dense = blocks.dense()
    assert dense.shape == (2 * width, width, 2 * width)
    assert (dense[:width, :, :width] == 1).all()
    assert (dense[width:, :, width:] == 2).all()
    assert np.count_nonzero(dense) == 2 * width**3


def test_leaves_beyond_one_piece_are_painted_too():
    states = np.random.default_rng(0).integers(1, 3, (50, 50, 50)).astype(np.uint8)
    key = np.argwhere(states).astype(np.int32)
    leaves = leaf_map([Leaves(16, key, states[tuple(key.T)])], 0.1, has_log_odds=False)
    np.testing.assert_array_equal(painted(leaves, 0.1)[0], states)


def test_the_highest_log_odds_win_whichever_leaf_comes_first():
    rng = np.random.default_rng(1)
    key = rng.permutation(np.argwhere(np.ones((6, 6, 6)))).astype(np.int32)
    value = rng.normal(-1, 1, len(key)).astype(np.float32)
    leaves = leaf_map([Leaves(16, key, value)], 0.1, has_log_odds=True)
    states, log_odds = painted(leaves, 0.3)
    dense = np.empty((6, 6, 6), np.float32)
    dense[tuple(key.T)] = value
    # Voxel 0 is voxel -32768 of the frame, the second one of its cell.
    cells = [slice(0, 2), slice(2, 5), slice(5, 6)]
    expected = np.array([[[dense[i, j, k].max() for k in cells] for j in cells] for i in cells])
    np.testing.assert_array_equal(log_odds, expected)
    np.testing.assert_array_equal(states, np.where(expected >= 0, 2, 1))


def test_a_far_voxel_costs_memory_at_the_asked_voxel_size_alone():
    data = oracle.file_of({(0, 0, 0, 16): 2, (65535, 65535, 65535, 16): 1, (512, 512, 512, 7): 1})
    tracemalloc.start()
    grid = decode_bt(data, voxel_size=50.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Centres of the voxels lie from -3276.75 to 3276.75 m, those of the wide leaf from -3225.55 to -3174.45 m.
    assert grid.shape == (132, 132, 132)
    assert (grid.num_occupied, grid.num_free) == (1, 1 + 2**3)
    assert peak < 20_000_000
