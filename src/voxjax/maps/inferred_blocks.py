"""Inferred free space of maps that are kept in blocks: tile by tile, and nothing where no surface is within reach."""

import numpy as np
from jaxtyping import Bool, Int32, UInt8

from .._types import FREE, OCCUPIED
from ..ops.blocks.block_array import BlockArray
from ..ops.blocks.block_builder import BlockBuilder
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
        here, around = _blocks(tile.low, tile.high), table[_blocks(tile.outer_low, tile.outer_high)]
        is_new, first = np.zeros(table[here].shape, bool), [cut.start for cut in here]
        if holds_any[around].any():
            enclosed = _enclosed(cells, around, holds_any[around], tile, reach, min_directions)
            # The cells of a block along z are four bytes, which are looked at as one number.
            columns = enclosed.view(np.uint32)
            a, b, c = (n // k for n, k in zip(columns.shape, (_CELLS, _CELLS, 1), strict=True))
            is_new = columns.reshape(a, _CELLS, b, _CELLS, c).max(axis=(1, 3)) != 0
            _add_freed(
                builder, np.argwhere(is_new) + first, pool, table[here][is_new], _by_blocks(enclosed)[is_new]
            )
        copy_blocks(builder, states, np.argwhere(~is_new & (table[here] != 0)) + first)
    return builder.finish()


def _blocks(low: np.ndarray, high: np.ndarray) -> tuple[slice, slice, slice]:
    """Blocks of a window that begins at one."""
    x, y, z = (slice(int(a) // BLOCK, -(-int(b) // BLOCK)) for a, b in zip(low, high, strict=True))
    return x, y, z


def _enclosed(
    cells: Bool[np.ndarray, "n 4 4 4"],
    rows: Int32[np.ndarray, "a b c"],
    holds_any: Bool[np.ndarray, "a b c"],
    tile: Tile,
    reach: float,
    min_directions: int,
) -> Bool[np.ndarray, "x y z"]:
    """Enclosed cells of the blocks of a tile.

    Args:
        cells: Occupied cells of the blocks of the pool.
        rows: Blocks of the wider window of the tile, as rows of the pool.
        holds_any: Which of them hold an occupied cell.
        tile: The tile.
        reach: Length of the rays [cell].
        min_directions: In how many directions something must be met.

    Returns:
        The cells of the tile, whole blocks of them; those beyond the box mean nothing.
    """
    a, b, c = rows.shape
    occupied = np.zeros((_CELLS * a, _CELLS * b, _CELLS * c), bool)
    _by_blocks(occupied)[holds_any] = cells[rows[holds_any]]
    # Whole blocks, also where the box ends within one: no ray is stopped by what lies beyond it.
    inner = _blocks(tile.low - tile.outer_low, tile.high - tile.outer_low)
    x, y, z = (slice(_CELLS * cut.start, _CELLS * cut.stop) for cut in inner)
    return is_enclosed(occupied, reach=reach, min_directions=min_directions, columns=(x, y))[x, y, z]


def _by_blocks(cells: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "a b c 4 4 4"]:
    """A view of cells, block by block."""
    a, b, c = (n // _CELLS for n in cells.shape)
    return cells.reshape(a, _CELLS, b, _CELLS, c, _CELLS).transpose(0, 2, 4, 1, 3, 5)


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
