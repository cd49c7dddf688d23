"""Classes of a very large grid in tiles, side by side on all cores of a CPU: only the counts of a few tiles are held.

A kernel on the whole grid holds counts of every voxel. Tiles take as much memory as a few of them need, in about the
same time, and give the same classes: each sees all voxels that its windows reach.
"""

from collections.abc import Callable
from itertools import product

import jax
import numpy as np
from jaxtyping import UInt8

from ..._runtime.placement import to_device
from ..._runtime.threads import spread
from ..._types import Array

TILE = 64
"""Voxels of a tile along x and y: what neighbours show twice grows with smaller tiles, the memory with larger ones."""

Classes = Callable[[Array], Array]
"""Classes of a whole grid (x, y, z), which counts voxels outside of it as empty."""


def is_worth_tiles(shape: tuple[int, ...], *, least: int = 1 << 26) -> bool:
    """Whether a grid is so large that the memory of one kernel is worth saving: hundreds of megabytes of counts."""
    return int(np.prod(shape, dtype=np.int64)) >= least


def classes_in_tiles(
    classes: Classes, occupied: Array, *, reach: int, tile: int = TILE
) -> UInt8[jax.Array, "x y z"]:
    """The classes that `classes` gives for a grid, tile by tile.

    Args:
        classes: Called with tiles of one shape, from several threads.
        occupied: True (or not 0) where a voxel is occupied, (x, y, z), no side of it 0.
        reach: How far the class of a voxel depends on others along each axis [voxel].
        tile: Voxels of a tile along x and y; along z a tile is as long as the grid.
    """
    grid = np.asarray(occupied)
    nx, ny, nz = grid.shape
    result = np.empty(grid.shape, np.uint8)
    side = tile + 2 * reach

    def fill(first: tuple[int, int]) -> None:
        # What a tile shows beyond the grid stays empty, as the grid's outside counts.
        shown = np.zeros((side, side, nz), bool)
        given, put = [], []
        for low, length in zip(first, (nx, ny), strict=True):
            begin, end = max(low - reach, 0), min(low + tile + reach, length)
            given.append(slice(begin, end))
            put.append(slice(begin - low + reach, end - low + reach))
        shown[put[0], put[1]] = grid[given[0], given[1]]
        inner = np.asarray(classes(shown))[reach : reach + tile, reach : reach + tile]
        x, y = first
        result[x : x + tile, y : y + tile] = inner[: nx - x, : ny - y]

    spread(fill, product(range(0, nx, tile), range(0, ny, tile)))
    return to_device(result)
