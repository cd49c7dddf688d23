"""Maps kept in blocks, and tiles so small that their borders cross the surfaces of small maps."""

import tracemalloc

import numpy as np

import small_worlds
import voxjax as vx
from voxjax.ops.blocks import over_tiles
from voxjax.ops.blocks.block_builder import BlockBuilder


def in_blocks(grid):
    """The same map, kept in blocks."""
    return vx.VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size, grid.log_odds_blocks())


def ways(grid, monkeypatch, *, most=1 << 18):
    """The map dense and in blocks, each seen in one tile and in several; the first is the dense one in one tile."""
    for voxels in (over_tiles.TILE, most):
        monkeypatch.setattr(over_tiles, "TILE", voxels)
        yield grid
        yield in_blocks(grid)


def turned_map():
    """A building of about a million voxels that lies across the axes."""
    return small_worlds.draw_map(small_worlds.pose(yaw=33.0, tilt=12.0), voxel_size=0.1)


def peak_of(function):
    """What a function gives, and the memory that NumPy and Python took for it at most [byte]."""
    tracemalloc.start()
    try:
        return function(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def far_apart(grid, shape=(4096, 4096, 256)):
    """A map in blocks with the same map in two corners of a box, whose origin is zero."""
    builder = BlockBuilder(shape, np.uint8)
    blocks = grid.state_blocks()
    size = np.asarray(blocks.table.shape)
    # The last blocks of the map must not be cut where the box goes on.
    last = np.asarray(shape) // 8 - size
    for index, values in blocks.parts():
        builder.add(index, values)
        builder.add(index + last, values)
    return vx.VoxelGrid(builder.finish(), np.zeros(3), grid.voxel_size)
