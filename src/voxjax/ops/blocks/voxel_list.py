"""Lists of voxels as block arrays: the cost is that of the list, whatever box it spans."""

import numpy as np
from jaxtyping import Int

from .block_array import BLOCK_VOXELS, BlockArray, Shape, lattice_shape
from .block_builder import BlockBuilder
from .words import BLOCK


def count_blocks(index: Int[np.ndarray, "n 3"]) -> int:
    """How many blocks hold the voxels of a list."""
    return len(_starts(np.sort(_block_numbers(index, index.max(axis=0, initial=0) + 1))))


def blocks_with(index: Int[np.ndarray, "n 3"], value: np.generic, shape: Shape) -> BlockArray:
    """The box with one value at the voxels of a list, and 0 elsewhere.

    Args:
        index: Voxels inside the box, in any order; one may be there several times.
        value: What they hold.
        shape: Number of voxels along x, y, z.
    """
    number = _block_numbers(index, shape)
    order = np.argsort(number)
    starts = _starts(number[order])
    builder = BlockBuilder(shape, value.dtype, capacity=len(starts) + 1)
    ends = np.append(starts, len(order))
    step = 1 << 13
    for first in range(0, len(starts), step):
        bounds = ends[first : first + step + 1]
        rows = order[bounds[0] : bounds[-1]]
        row = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
        blocks = np.zeros((len(bounds) - 1, BLOCK, BLOCK, BLOCK), value.dtype)
        x, y, z = (index[rows] & (BLOCK - 1)).T
        blocks.reshape(-1)[BLOCK_VOXELS * row + (x << 6 | y << 3 | z)] = value
        builder.add(index[order[bounds[:-1]]] >> 3, blocks)
    return builder.finish()


def _block_numbers(index: np.ndarray, shape: tuple[int, ...] | np.ndarray) -> np.ndarray:
    """Number int64 of the block of each voxel, in C order over the box."""
    _, b, c = lattice_shape(tuple(int(n) for n in shape))
    x, y, z = (index >> 3).astype(np.int64, copy=False).T
    return (x * b + y) * c + z


def _starts(ordered: np.ndarray) -> np.ndarray:
    """Where a sorted list has a number that is not the one before."""
    is_first = np.ones(len(ordered), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=is_first[1:])
    return np.flatnonzero(is_first)
