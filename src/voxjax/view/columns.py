"""Columns of a map as they are seen from above, by what the map holds: nothing here has the size of its box."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Int, UInt8

from ..ops.blocks.words import BLOCK

if TYPE_CHECKING:
    from ..grid import VoxelGrid


class Columns(NamedTuple):
    """The topmost voxel of each column that holds one.

    Attributes:
        place: int (n, 2): x and y of the columns, in lexicographic order.
        top: int (n,): z of the topmost voxel.
        color: uint8 (n, 3): its colour.
    """

    place: Int[np.ndarray, "n 2"]
    top: Int[np.ndarray, " n"]
    color: UInt8[np.ndarray, "n 3"]


def top_columns(index: Int[np.ndarray, "n 3"], color: UInt8[np.ndarray, "n 3"]) -> Columns:
    """The topmost of some voxels in each column.

    Args:
        index: Voxels, in lexicographic order.
        color: The colour of each.
    """
    is_last = np.ones(len(index), bool)
    is_last[:-1] = (index[1:, :2] != index[:-1, :2]).any(axis=1)
    return Columns(index[is_last, :2], index[is_last, 2], color[is_last])


def free_columns(
    grid: VoxelGrid, cut: int, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]
) -> Bool[np.ndarray, "x y"]:
    """Which columns of a window hold a free voxel below some height.

    Args:
        grid: The map.
        cut: The height [voxel].
        low: Lowest x and y of the window, inside the box.
        high: One past the highest.
    """
    blocks = grid.state_blocks()
    first, end = low // BLOCK, -(-high // BLOCK)
    pool, table = np.ascontiguousarray(blocks.pool), np.asarray(blocks.table)
    table = table[first[0] : end[0], first[1] : end[1], : -(-cut // BLOCK)]
    found = np.zeros((*(end - first).tolist(), BLOCK, BLOCK), bool)
    # Eight voxels above each other are looked at as one number, whose lowest byte is the lowest voxel. Of the states,
    # the free one alone is odd.
    word, is_free = pool.view("<u8")[..., 0], 0x0101010101010101
    whole, rest = divmod(cut, BLOCK)
    # Of the layer of blocks that the cut goes through, the voxels below it count.
    for layers, mask in (
        (table[:, :, :whole], is_free),
        (table[:, :, whole:], is_free & ((1 << 8 * rest) - 1)),
    ):
        # Some blocks at a time: the numbers take as much memory as the blocks.
        pieces = (word[start : start + (1 << 13)] for start in range(0, len(word), 1 << 13))
        has_free = np.concatenate([(piece & np.uint64(mask)) != 0 for piece in pieces])
        x, y, z = np.nonzero(np.asarray(has_free.any(axis=(1, 2)))[layers])
        np.logical_or.at(found, (x, y), has_free[layers[x, y, z]])
    columns = found.transpose(0, 2, 1, 3).reshape(BLOCK * found.shape[0], BLOCK * found.shape[1])
    begin, size = low - BLOCK * first, high - low
    return columns[begin[0] : begin[0] + size[0], begin[1] : begin[1] + size[1]]
