"""Leaves cut at the borders of blocks: each cell of each leaf is in one part or box, once."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.io import leaf_parts
from voxjax.io.canvas import canvas_for
from voxjax.io.leaf_parts import cut_leaves
from voxjax.io.leaves import Leaves, leaf_map
from voxjax.ops.blocks.block_array import lattice_shape


def filled_by(cut, shape):
    """How often each cell of the blocks is filled, and the value of the last that fills it."""
    lattice = lattice_shape(shape)
    count, value = (np.zeros([8 * n for n in lattice], np.int64) for _ in range(2))

    def fill(low, high, some):
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        count[box] += 1
        value[box] = some

    for low, size, some in zip(*cut.boxes, strict=True):
        fill(8 * low, 8 * (low + size), some)
    for cell, code, some in zip(*cut.parts, strict=True):
        block = np.array(np.unravel_index(cut.block[cell >> 9], lattice))
        corner = np.array([cell >> 6 & 7, cell >> 3 & 7, cell & 7])
        size = np.array([code >> 6, code >> 3 & 7, code & 7]) + 1
        assert (corner + size <= 8).all()
        fill(8 * block + corner, 8 * block + corner + size, some)
    return count[tuple(map(slice, shape))], value[tuple(map(slice, shape))]


@given(st.integers(0, 2**32 - 1), st.booleans())
@settings(max_examples=20, deadline=None)
def test_parts_and_boxes_are_the_leaves(seed, is_small):
    rng = np.random.default_rng(seed)
    few, leaf_parts.FEW_BLOCKS = leaf_parts.FEW_BLOCKS, leaf_parts.FEW_BLOCKS if is_small else 0
    levels = []
    for depth in (11, 14, 15, 16):
        width = 1 << (16 - depth)
        # Leaves of one level, in a layer of their own.
        key = np.unique(rng.integers(0, 96 // width, (6, 3)), axis=0) * width + [1024 + 96 * depth, 512, 256]
        levels.append(Leaves(depth, key.astype(np.int32), rng.integers(1, 3, len(key)).astype(np.uint8)))
    leaves = leaf_map(levels, 0.1, has_log_odds=False)
    leaves = leaves.cut(leaves.low + rng.integers(0, 9, 3), leaves.high)
    cut = cut_leaves(leaves, canvas_for(leaves, 0.1))
    leaf_parts.FEW_BLOCKS = few
    count, value = filled_by(cut, leaves.shape)
    expected = np.zeros(leaves.shape, np.uint8)
    for level in leaves.levels:
        for low, high, state in zip(*leaves.boxes(level), level.value, strict=True):
            expected[tuple(slice(a, b) for a, b in zip(low - leaves.low, high - leaves.low, strict=True))] = (
                state
            )
    assert (count == (expected != 0)).all()
    np.testing.assert_array_equal(value, expected)


def test_a_wide_leaf_is_one_box_and_the_parts_of_its_surface():
    far = Leaves(16, np.zeros((1, 3), np.int32) + 3, np.array([2], np.uint8))
    wide = Leaves(7, np.full((1, 3), 512, np.int32), np.array([1], np.uint8))
    leaves = leaf_map([wide, far], 0.1, has_log_odds=False)
    cut = cut_leaves(leaves, canvas_for(leaves, 0.1))
    # It begins 509 voxels from the lowest one: 63 whole blocks along each axis, and a part of one at either end.
    assert cut.boxes.size.tolist() == [[63, 63, 63]]
    assert len(cut.parts.cell) == len(cut.block) == 1 + 65**3 - 63**3
