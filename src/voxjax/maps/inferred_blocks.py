"""Inferred free space of maps that are kept in blocks: tile by tile, and nothing where no surface is within reach."""

import numpy as np
from jaxtyping import Bool, UInt8

from .._types import FREE, OCCUPIED
from ..ops.blocks.block_array import BlockArray, BlockBuilder
from ..ops.blocks.edit import copy_blocks
from ..ops.blocks.windows import TILE, Tile, cut_tiles
from ..ops.blocks.words import BLOCK
from ..ops.surface.enclosure import is_enclosed

CELL = 2
"""Voxels that a cell is wide: an eighth of the work, and rays do not slip through surfaces one voxel thin."""

_CELLS = BLOCK // CELL
"""Cells that a block is wide."""


def infer_in_blocks(
    states: BlockArray, *, reach: float, min_directions: int, most: int = 8 * TILE
) -> BlockArray:
    """The states with enclosed unknown voxels free.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        reach: Length of the rays [cell].
        min_directions: A cell is enclosed if a surface lies in at least so many of the 26 directions.
        most: Voxels of a tile, about: tiles are of cells, an eighth as many, and wide beside the reach of the rays.
    """
    pool, table = np.asarray(states.pool), np.asarray(states.table)
    pairs = (pool == OCCUPIED).reshape(-1, _CELLS, CELL, _CELLS, CELL, _CELLS, CELL)
    cells = pairs.any(axis=(2, 4, 6))
    holds_any = cells.any(axis=(1, 2, 3))
    builder = BlockBuilder(states.shape, states.dtype)
    # Whole blocks, so that the windows of neighbouring tiles have the same cells.
    halo = BLOCK * -(-int(reach) // _CELLS)
    for tile in cut_tiles(states.shape, halo=halo, most=most):
        here = _blocks(tile.low, tile.high)
        rows = table[_blocks(tile.outer_low, tile.outer_high)]
        is_new, first = np.zeros(table[here].shape, bool), [cut.start for cut in here]
        if holds_any[rows].any():
            enclosed = _enclosed(cells[rows], tile, reach=reach, min_directions=min_directions)
            is_new = enclosed.any(axis=(3, 4, 5))
            _add_freed(builder, np.argwhere(is_new) + first, pool, table[here][is_new], enclosed[is_new])
        copy_blocks(builder, states, np.argwhere(~is_new & (table[here] != 0)) + first)
    return builder.finish()


def _blocks(low: np.ndarray, high: np.ndarray) -> tuple[slice, slice, slice]:
    """Blocks of a window that begins at one."""
    x, y, z = (slice(int(a) // BLOCK, -(-int(b) // BLOCK)) for a, b in zip(low, high, strict=True))
    return x, y, z


def _enclosed(
    cells: Bool[np.ndarray, "a b c 4 4 4"], tile: Tile, *, reach: float, min_directions: int
) -> Bool[np.ndarray, "a2 b2 c2 4 4 4"]:
    """Enclosed cells of the blocks of a tile.

    Args:
        cells: Occupied cells of the blocks of its wider window.
        tile: The tile.
        reach: Length of the rays [cell].
        min_directions: In how many directions something must be met.
    """
    a, b, c = cells.shape[:3]
    occupied = cells.transpose(0, 3, 1, 4, 2, 5).reshape(_CELLS * a, _CELLS * b, _CELLS * c)
    # Beyond the box there is no cell that a ray could end in, or that could be free.
    size = -(-(tile.outer_high - tile.outer_low) // CELL)
    x, y, z = (
        slice(int(s) // CELL, -(-int(e) // CELL))
        for s, e in zip(tile.low - tile.outer_low, tile.high - tile.outer_low, strict=True)
    )
    found = is_enclosed(
        occupied[tuple(map(slice, size))], reach=reach, min_directions=min_directions, columns=(x, y)
    )[x, y, z]
    found = np.pad(found, [(0, -n % _CELLS) for n in found.shape])
    a, b, c = (n // _CELLS for n in found.shape)
    return found.reshape(a, _CELLS, b, _CELLS, c, _CELLS).transpose(0, 2, 4, 1, 3, 5)


def _add_freed(
    builder: BlockBuilder,
    index: np.ndarray,
    pool: UInt8[np.ndarray, "n 8 8 8"],
    rows: np.ndarray,
    enclosed: Bool[np.ndarray, "m 4 4 4"],
) -> None:
    """Put blocks with the unknown voxels of their enclosed cells free at places (m, 3) of the table."""
    step = 1 << 12
    for start in range(0, len(index), step):
        part = slice(start, start + step)
        free = enclosed[part].view(np.uint8) * FREE
        for axis in (1, 2, 3):
            free = np.repeat(free, CELL, axis=axis)
        # Of the states, unknown is the least and free the next one.
        builder.add(index[part], np.maximum(pool[rows[part]], free))
