"""Classes of a grid in tiles, side by side on all cores of a CPU: what is counted stays in the cache of a core.

A kernel on the whole grid holds counts of every voxel, in memory that the operating system hands out page by page and
that is read again 27 times. Tiles take as much as a few of them need, whatever the grid, and give the same classes: a
tile is counted with all voxels that its windows reach, and only its own ones are classified.
"""

from collections.abc import Callable
from itertools import product

import jax
import numpy as np
from jaxtyping import UInt8

from ..._runtime.placement import to_device
from ..._runtime.tables import reserve
from ..._runtime.threads import spread
from ..._types import Array

TILE = (32, 64, 256)
"""Voxels of a tile along x, y and z at most: what neighbours count twice grows with smaller tiles, the memory with
larger ones. Counts of such a tile take 1.5 MB, and rows along z are what vector loops run over."""

Classes = Callable[[Array], Array]
"""Classes of the voxels of a tile, from the tile with the voxels around it that they depend on."""


def is_worth_tiles(shape: tuple[int, ...], *, least: int = 1 << 22) -> bool:
    """Whether a grid is so large that one kernel would take memory which the C library does not keep at hand.

    Up to there a kernel of whole passes is as fast, or faster: it counts no voxel twice.
    """
    return int(np.prod(shape, dtype=np.int64)) >= least


def classes_in_tiles(
    classes: Classes, occupied: Array, *, reach: int, tile: tuple[int, int, int] = TILE
) -> UInt8[jax.Array, "x y z"]:
    """The classes of a grid, tile by tile.

    Args:
        classes: Called with tiles of one shape, from several threads; a tile has uint8, 1 where a voxel is occupied,
            and `reach` voxels more on every side than the classes that are asked for.
        occupied: True (or not 0) where a voxel is occupied, (x, y, z), no side of it 0.
        reach: How far the class of a voxel depends on others along each axis [voxel].
        tile: Voxels of a tile along each axis, at most.
    """
    grid = np.asarray(occupied)
    # As many tiles along an axis as are needed, all of one length: the last one has little beyond the grid.
    sides = [-(-length // -(-length // most)) for length, most in zip(grid.shape, tile, strict=True)]
    # Zeros, in memory that JAX takes as it is.
    result = reserve(grid.size, dtype=np.uint8).reshape(grid.shape)

    def fill(first: tuple[int, ...]) -> None:
        own = tuple(slice(low, low + side) for low, side in zip(first, sides, strict=True))
        # Where nothing is occupied all classes are 0, which the result holds already.
        if not grid[own].any():
            return
        # What a tile shows beyond the grid stays empty, as the grid's outside counts.
        shown = np.zeros([side + 2 * reach for side in sides], np.uint8)
        given, put = [], []
        for low, side, length in zip(first, sides, grid.shape, strict=True):
            begin, end = max(low - reach, 0), min(low + side + reach, length)
            given.append(slice(begin, end))
            put.append(slice(begin - low + reach, end - low + reach))
        np.not_equal(grid[tuple(given)], 0, out=shown[tuple(put)].view(bool))
        target = result[own]
        target[...] = np.asarray(classes(shown))[tuple(slice(length) for length in target.shape)]

    spread(fill, product(*(range(0, n, side) for n, side in zip(grid.shape, sides, strict=True))))
    return to_device(result)
