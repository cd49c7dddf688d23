"""Memory that a map takes as leaves and in blocks, estimated from the leaves before any block is made."""

import math

import numpy as np

from ..ops.blocks.block_array import BLOCK_VOXELS, lattice_shape
from ..ops.blocks.words import BLOCK
from .canvas import canvas_for, cells_of
from .leaf_parts import FEW_BLOCKS, CutLeaves, cut_leaves
from .leaves import LeafMap, pieces
from .paint import BLOCKS_AT_ONCE


def most_bytes(leaves: LeafMap, voxel_size: float, shape: tuple[int, ...]) -> float:
    """Most that painting a map may take, told from the widths of its leaves alone [byte].

    Args:
        leaves: The map, not empty.
        voxel_size: Width of the grid's voxels [m].
        shape: Its number of voxels along x, y, z.
    """
    parts = written = 0
    for level in leaves.levels:
        width = math.ceil(level.width * leaves.resolution / voxel_size)
        # Blocks along an axis that a leaf meets at most, and those that it fills at least.
        met, filled = -(-width // BLOCK) + (width > 1), max(width // BLOCK - 1, 0)
        parts += len(level.key) * (met**3 - filled**3)
        written += len(level.key) * met**3
    num_blocks = math.prod(lattice_shape(shape))
    return _bytes(leaves, min(parts, num_blocks), parts, written, num_blocks)


def cutting_bytes(leaves: LeafMap, voxel_size: float, shape: tuple[int, ...]) -> float:
    """What it takes to cut the leaves of a map, which the count of its blocks needs [byte].

    Args:
        leaves: The map, not empty.
        voxel_size: Width of the grid's voxels [m].
        shape: Its number of voxels along x, y, z.
    """
    parts = written = 0
    canvas = canvas_for(leaves, voxel_size)
    for level in leaves.levels:
        for piece in pieces(level):
            low, size = (np.stack(along).astype(np.int64) for along in cells_of(leaves, canvas, piece))
            met = ((low + size - 1) >> 3) - (low >> 3) + 1
            filled = np.maximum(((low + size) >> 3) - ((low + 7) >> 3), 0)
            written += int(met.prod(axis=0).sum())
            parts += int((met.prod(axis=0) - filled.prod(axis=0)).sum())
    return _bytes(leaves, 0, parts, written, math.prod(lattice_shape(shape)))


def painting_bytes(leaves: LeafMap, voxel_size: float, shape: tuple[int, ...]) -> float:
    """About what painting a map takes, the leaves and the blocks that come out among it [byte].

    Args:
        leaves: The map, not empty.
        voxel_size: Width of the grid's voxels [m].
        shape: Its number of voxels along x, y, z.
    """
    cut = cut_leaves(leaves, canvas_for(leaves, voxel_size))
    num_written = len(cut.block) + int(cut.boxes.size.prod(axis=1, dtype=np.int64).sum())
    # A box is three times as many numbers as a part.
    num_parts = len(cut.parts.cell) + 3 * len(cut.boxes.value)
    return _bytes(leaves, count_blocks(cut), num_parts, num_written, math.prod(lattice_shape(shape)))


def count_blocks(cut: CutLeaves) -> int:
    """How many different blocks a map has beside those of one value; a few less, where leaves share cells."""
    parts = cut.parts
    row = parts.cell >> 9
    # The size of a part is the number of a cell: its places along the axes, three bits each, are the lengths less one.
    volume = ((parts.size >> 6) + 1) * ((parts.size >> 3 & 7) + 1) * ((parts.size & 7) + 1)
    filled = np.bincount(row, volume, len(cut.block))
    lowest = np.full(len(cut.block), np.inf, np.float32)
    highest = -lowest
    np.minimum.at(lowest, row, parts.value)
    np.maximum.at(highest, row, parts.value)
    is_level = (filled >= BLOCK_VOXELS) & (lowest == highest)
    return int(np.count_nonzero(filled)) - int(np.count_nonzero(is_level))


def _bytes(leaves: LeafMap, num_mixed: int, num_parts: int, num_written: int, num_blocks: int) -> float:
    """Memory of painting [byte].

    Args:
        leaves: The map.
        num_mixed: Blocks that hold several values.
        num_parts: Parts that its leaves are cut into.
        num_written: Entries of tables that are written.
        num_blocks: Entries that a table has.
    """
    width = 5 if leaves.has_log_odds else 1
    # A page of the table that has one entry has all of them.
    tables = (3 if leaves.has_log_odds else 2) * min(4.0 * num_blocks, 4096.0 * num_written)
    # What is painted at a time, which is all blocks of a small box, and a copy of what of it differs.
    painted = num_blocks if num_blocks <= FEW_BLOCKS else min(num_mixed, BLOCKS_AT_ONCE)
    painting = (painted + min(num_mixed, BLOCKS_AT_ONCE)) * BLOCK_VOXELS * width
    return leaves.num_bytes + 40.0 * num_parts + num_mixed * BLOCK_VOXELS * width + tables + painting
