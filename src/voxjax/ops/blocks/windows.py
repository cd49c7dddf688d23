"""Parts of block arrays: windows as block arrays of their own, and tiles for kernels that work on dense arrays."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from .block_array import BlockArray, lattice_shape
from .block_builder import BlockBuilder
from .words import BLOCK

TILE = 1 << 24
"""Voxels of a tile, about: a map of a building is one tile, and what kernels make of one stays below a gigabyte."""


class Tile(NamedTuple):
    """A window of a box, and the wider one that kernels need around it.

    Attributes:
        low: int64 (3,): lowest voxel of the window.
        high: int64 (3,): one past its highest.
        outer_low: int64 (3,): lowest voxel of the wider window, which ends where the box ends.
        outer_high: int64 (3,): one past its highest.
    """

    low: np.ndarray
    high: np.ndarray
    outer_low: np.ndarray
    outer_high: np.ndarray

    @property
    def inner(self) -> tuple[slice, slice, slice]:
        """Where the window lies in the wider one."""
        x, y, z = (
            slice(a, b) for a, b in zip(self.low - self.outer_low, self.high - self.outer_low, strict=True)
        )
        return x, y, z


def cut_tiles(shape: tuple[int, ...], *, halo: int, most: int = TILE) -> list[Tile]:
    """Cut a box into tiles of whole blocks.

    Args:
        shape: Number of voxels along x, y, z.
        halo: How far kernels look beyond a tile [voxel].
        most: Voxels of a tile; no tile is narrower than eight blocks.

    Returns:
        Tiles in C order; one, without a halo, where the box has no more voxels.
    """
    sides = np.maximum(np.asarray(shape, np.int64), 1)
    least = 8 * BLOCK
    while np.prod(sides) > most and sides.max() > least:
        # Half of the longest side, in whole blocks.
        axis = int(sides.argmax())
        sides[axis] = max(-(-sides[axis] // (2 * BLOCK)) * BLOCK, least)
    tiles = []
    for number in np.ndindex(*(-(-n // side) for n, side in zip(shape, sides, strict=True))):
        low = np.asarray(number, np.int64) * sides
        high = np.minimum(low + sides, shape)
        tiles.append(Tile(low, high, np.maximum(low - halo, 0), np.minimum(high + halo, shape)))
    return tiles


def tile_rows(tiles: list[Tile], index: Int[np.ndarray, "n 3"]) -> Iterator[tuple[Tile, np.ndarray | slice]]:
    """Rows of a list of voxels, tile by tile; tiles that hold none of them are left out.

    Args:
        tiles: What `cut_tiles` gives.
        index: Voxels inside the box.

    Yields:
        A tile and the rows of its voxels, in ascending order.
    """
    if len(tiles) == 1:
        yield tiles[0], slice(None)
        return
    # All tiles but the last along an axis are as wide as the first.
    sides = tiles[0].high - tiles[0].low
    counts = tiles[-1].low // sides + 1
    number = np.asarray(np.ravel_multi_index(tuple((index // sides).T), tuple(counts.tolist())))
    order = number.argsort(kind="stable")
    ends = np.searchsorted(number[order], np.arange(len(tiles) + 1))
    for tile, start, stop in zip(tiles, ends[:-1], ends[1:], strict=True):
        if stop > start:
            yield tile, order[start:stop]


def cut_out(array: BlockArray, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> BlockArray:
    """A window as an array of its own; what holds one value is not taken apart.

    Args:
        array: What it is cut out of.
        low: Lowest voxel, inside the box.
        high: One past the highest, inside the box too.
    """
    low, high = np.asarray(low, np.int64), np.asarray(high, np.int64)
    if not low.any() and tuple(high) == array.shape:
        return array
    shape = tuple((high - low).tolist())
    builder = BlockBuilder(shape, array.dtype)
    table, pool = np.asarray(array.table), np.asarray(array.pool)
    first, offset = low // BLOCK, low % BLOCK
    # Each block of the window meets two along each axis where it lies between them; beyond the box all is row 0.
    met = {}
    for step in np.ndindex(*(2 if o else 1 for o in offset)):
        part = table[tuple(slice(b, b + n) for b, n in zip(first + step, lattice_shape(shape), strict=True))]
        missing = [(0, n - m) for n, m in zip(lattice_shape(shape), part.shape, strict=True)]
        met[step] = np.pad(part, missing) if any(after for _, after in missing) else part
    rows = next(iter(met.values()))
    is_one = array.is_uniform[rows]
    for part in met.values():
        is_one &= part == rows
    level = np.argwhere(is_one & (rows != 0))
    builder.put(level, pool[rows[tuple(level.T)], 0, 0, 0])
    places = np.argwhere(~is_one)
    # Few at a time: what they are put together from stays in the cache.
    count = 1 << 10
    for start in range(0, len(places), count):
        index = places[start : start + count]
        blocks = np.empty((len(index), BLOCK, BLOCK, BLOCK), array.dtype)
        for step, part in met.items():
            pairs = list(zip(step, offset.tolist(), strict=True))
            source = tuple(slice(0, o) if s else slice(o, None) for s, o in pairs)
            target = tuple(slice(BLOCK - o, None) if s else slice(0, BLOCK - o) for s, o in pairs)
            blocks[(slice(None), *target)] = pool[(part[tuple(index.T)], *source)]
        builder.add(index, blocks)
    return builder.finish()
