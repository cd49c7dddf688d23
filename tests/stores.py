"""Maps that lie in chunks, as those of a store do, and the chunks that were read of them."""

import numpy as np

from voxjax import VoxelGrid
from voxjax.ops.blocks.chunked_array import ChunkedArray


def chunked(dense, chunk, reads):
    """The array in chunks; the place of each that is read is put into a list."""
    lattice = tuple(-(-n // side) for n, side in zip(dense.shape, chunk, strict=True))

    def read(place):
        reads.append(place)
        return part(place).copy()

    def part(place):
        return dense[tuple(slice(p * side, (p + 1) * side) for p, side in zip(place, chunk, strict=True))]

    known = np.array([part(place).any() for place in np.ndindex(*lattice)]).reshape(lattice)
    return ChunkedArray(dense.shape, dense.dtype, chunk, known, read)


def stored(grid, *, chunk=(16, 24, 8)):
    """The same map in chunks, and the list of those that are read."""
    reads: list[tuple[int, int, int]] = []
    states = chunked(np.asarray(grid.states), chunk, reads)
    log_odds = None if grid.log_odds is None else chunked(np.asarray(grid.log_odds), chunk, reads)
    return VoxelGrid(states, grid.origin, grid.voxel_size, log_odds), reads
