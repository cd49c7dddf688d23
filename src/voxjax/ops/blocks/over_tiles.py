"""`over_tiles`: kernels that look at dense windows around listed voxels, over a box of any size."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Int

from .windows import TILE, cut_tiles, tile_rows

Rows = np.ndarray | slice
"""Rows of a list: their numbers, ascending, or all of them."""


def over_tiles(
    kernel: Callable[[Any, np.ndarray, Rows], Any],
    window: Callable[[np.ndarray, np.ndarray], Any],
    index: Int[np.ndarray, "n 3"],
    shape: tuple[int, ...],
    *,
    halo: int,
    most: int | None = None,
) -> Any:
    """What a kernel gives for each of some voxels, whose surroundings it sees in dense windows.

    A box of few voxels is one window, and the kernel is called once. A larger one is worked on tile by tile, one after
    the other, so that the memory is that of a tile and of the list; a tile is cut to its voxels and the halo around
    them, and one without a voxel is left out.

    Args:
        kernel: Called with a window, its lowest voxel int64 (3,), and the rows of the voxels in it; gives a tree of
            NumPy arrays, one row a voxel.
        window: Gives what the kernel needs of the box from a lowest voxel up to and without a highest one, such as
            `VoxelGrid.states_in`.
        index: Voxels inside the box.
        shape: Number of voxels of the box along x, y, z.
        halo: How far the kernel looks beyond a voxel, at most [voxel].
        most: Voxels of a tile, about; None for `windows.TILE`.

    Returns:
        The tree, one row a voxel in the order of the list.
    """
    tiles = cut_tiles(shape, halo=halo, most=TILE if most is None else most)
    if len(tiles) == 1:
        low = np.zeros(3, np.int64)
        return kernel(window(low, np.asarray(shape, np.int64)), low, slice(None))
    found = None
    for _, rows in tile_rows(tiles, index):
        some = index[rows].astype(np.int64)
        low = np.maximum(some.min(axis=0) - halo, 0)
        high = np.minimum(some.max(axis=0) + 1 + halo, shape)
        part = kernel(window(low, high), low, rows)
        if found is None:
            # The first part says what rows there are.
            found = jax.tree.map(lambda a: np.empty((len(index), *a.shape[1:]), a.dtype), part)
        for whole, values in zip(jax.tree.leaves(found), jax.tree.leaves(part), strict=True):
            whole[rows] = values
    if found is None:
        # A list without a voxel: the kernel says what arrays its rows would be in.
        low = np.zeros(3, np.int64)
        return kernel(window(low, np.minimum(1, shape)), low, np.zeros(0, np.int64))
    return found
