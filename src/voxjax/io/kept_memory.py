"""Memory that a map takes as it is kept, beside that of dense arrays: of a grid, or of leaves before there is one."""

from typing import Literal, NamedTuple

import numpy as np

from ..grid import VoxelGrid
from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray
from .block_need import count_blocks
from .budget import Budget
from .canvas import canvas_for
from .leaf_parts import Parts, cut_leaves
from .leaves import LeafMap


class KeptMemory(NamedTuple):
    """How a map is kept, and what that takes.

    Attributes:
        form: "blocks", "dense" arrays, or a "store" on the disk, of which windows are read.
        num_bytes: Memory [byte]; None for a store, and where counting the blocks would take much more than the file.
    """

    form: Literal["blocks", "dense", "store"]
    num_bytes: int | None


def memory_of_grid(grid: VoxelGrid) -> KeptMemory:
    """How a grid is kept; of blocks those that hold several values, and the entries of the table that are not 0."""
    if grid.is_stored:
        return KeptMemory("store", None)
    if not grid.is_sparse:
        return KeptMemory("dense", grid.num_voxels * (5 if grid.has_log_odds else 1))
    log_odds = grid.log_odds_blocks()
    size = _bytes_of_blocks(grid.state_blocks())
    return KeptMemory("blocks", size + (0 if log_odds is None else _bytes_of_blocks(log_odds)))


def _bytes_of_blocks(blocks: BlockArray) -> int:
    """Memory of an array in blocks, without what is reserved for more [byte]."""
    num_mixed, num_entries = int(np.count_nonzero(~blocks.is_uniform)), int(blocks.uses[1:].sum())
    return num_mixed * BLOCK_VOXELS * blocks.dtype.itemsize + 4 * num_entries


def memory_of_leaves(leaves: LeafMap, budget: Budget) -> KeptMemory:
    """How the grid of a map's leaves at their own voxel size will be kept, without making it.

    Args:
        leaves: The map.
        budget: What reading its file may take.
    """
    if not leaves.levels:
        return KeptMemory("blocks", 0)
    # A few wide leaves that lie across the borders of blocks have millions of parts, whatever the size of the file.
    if _most_parts(leaves) > 8 * leaves.num_leaves + (1 << 16):
        return KeptMemory("blocks", None)
    if budget.excess(100.0 * _most_parts(leaves)) is not None:
        return KeptMemory("blocks", None)
    cut = cut_leaves(leaves, canvas_for(leaves, leaves.resolution), has_table=False)
    # Blocks that hold nothing have parts in no small lattice.
    num_entries = len(np.unique(cut.parts.cell >> 9)) + int(cut.boxes.size.prod(axis=1, dtype=np.int64).sum())
    if not leaves.has_log_odds:
        return KeptMemory("blocks", count_blocks(cut) * BLOCK_VOXELS + 4 * num_entries)
    states = cut._replace(
        parts=Parts(cut.parts.cell, cut.parts.size, (cut.parts.value >= 0).astype(np.uint8))
    )
    num_rows = count_blocks(states) + 4 * count_blocks(cut)
    return KeptMemory("blocks", num_rows * BLOCK_VOXELS + 8 * num_entries)


def _most_parts(leaves: LeafMap) -> int:
    """Parts that the leaves of a map are cut into at most, whatever the borders of blocks are."""
    total = 0
    for level in leaves.levels:
        met = level.width // 8 + 1 if level.width > 1 else 1
        total += len(level.key) * (met**3 - max(level.width // 8 - 1, 0) ** 3)
    return total
