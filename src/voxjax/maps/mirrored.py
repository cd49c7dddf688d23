"""A prepared map's mirror image, and the map in another unit of length, from what is known: no field is made anew."""

from dataclasses import replace

import numpy as np
from jaxtyping import Int, Shaped

from .._runtime.placement import to_device
from .._runtime.tables import as_table, reserve
from .._types import Array
from ..grid import VoxelGrid
from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray, lattice_shape
from ..ops.blocks.words import BLOCK
from ..ops.evidence.nearest import INDEX_BITS, NOTHING_NEAR
from .prepared import PreparedMap


def mirrored_grid(grid: VoxelGrid) -> VoxelGrid:
    """The map with x taken for -x, without log-odds; the box is filled up with what is unknown to whole blocks along x.

    Args:
        grid: The map.
    """
    blocks = grid.state_blocks()
    table, pool = np.asarray(blocks.table)[::-1].copy(), np.asarray(blocks.pool)[:, ::-1].copy()
    shape = (BLOCK * len(table), *blocks.shape[1:])
    origin = np.array(grid.origin, np.float64)
    origin[0] = -(origin[0] + shape[0] * grid.voxel_size)
    return VoxelGrid(BlockArray(table, pool, shape), origin, grid.voxel_size)


def mirrored(prepared: PreparedMap) -> PreparedMap:
    """What `prepare_map` gives for the mirror image of a map, but for ties of nearest voxels and for rounding.

    Args:
        prepared: The map; x is taken for -x.
    """
    grid = mirrored_grid(prepared.grid)
    # Lists follow the voxels in C order: layers across x come the other way round, each as it is.
    order = np.argsort(-prepared.grid.occupied_index()[:, 0], kind="stable")
    lists = {
        name: _reordered(getattr(prepared, name), order)
        for name in ("points", "anchors", "normals", "sides", "weights", "planarity")
    }
    for name in ("points", "anchors", "normals", "sides"):
        lists[name][: len(order), 0] *= -1.0
    table, rows = _mirrored_table(prepared)
    pools = {
        name: _mirrored_pool(getattr(prepared, name), rows) for name in ("codes", "rough_codes", "states")
    }
    keys = _mirrored_pool(prepared.keys, rows)
    _renumber(keys[: len(rows) * BLOCK_VOXELS], order)
    centroid = np.asarray(prepared.centroid) * np.asarray([-1.0, 1.0, 1.0], np.float32)
    dims = np.asarray(grid.shape, np.int32)
    parts = {**lists, **pools, "keys": keys, "table": table, "dims": dims, "centroid": centroid}
    return replace(prepared, grid=grid, **to_device(parts))


def _reordered(rows: Array, order: Int[np.ndarray, "n"]) -> np.ndarray:
    """A list of a map in another order, with the padding that it had."""
    return as_table(np.asarray(rows)[order], len(rows))


def _mirrored_table(prepared: PreparedMap) -> tuple[np.ndarray, Int[np.ndarray, "m"]]:
    """Table of the mirror image, and the row of the map's pools that each row of its pools is made of."""
    num_blocks = prepared.num_blocks
    lattice = lattice_shape(prepared.grid.shape)
    table = reserve(len(prepared.table), dtype=np.int32)
    table[:num_blocks] = np.asarray(prepared.table)[:num_blocks].reshape(lattice)[::-1].reshape(-1)
    # Blocks that have a row of their own have them in C order.
    own = np.flatnonzero(table[:num_blocks] >= prepared.num_shared)
    rows = np.concatenate([np.arange(prepared.num_shared, dtype=np.int32), table[own]])
    table[own] = np.arange(prepared.num_shared, prepared.num_rows, dtype=np.int32)
    return table, rows


def _mirrored_pool(pool: Shaped[Array, "cells"], rows: Int[np.ndarray, "m"]) -> Shaped[np.ndarray, "cells"]:
    """Pool of the mirror image: blocks in their new order, each reversed along x."""
    blocks = np.asarray(pool).reshape(-1, BLOCK, BLOCK * BLOCK)
    found = reserve(len(pool), dtype=blocks.dtype)
    # What follows the map in its pools is left untouched, or it would take memory for nothing.
    found[: len(rows) * BLOCK_VOXELS] = blocks[rows, ::-1].reshape(-1)
    return found


def _renumber(keys: np.ndarray, order: Int[np.ndarray, "n"]) -> None:
    """Let keys point to where voxels are listed now; `order` has the row of each before."""
    place = np.empty(len(order), np.uint32)
    place[order] = np.arange(len(order), dtype=np.uint32)
    is_near = keys != NOTHING_NEAR
    near = keys[is_near]
    squared = near >> np.uint32(INDEX_BITS) << np.uint32(INDEX_BITS)
    keys[is_near] = squared | place[near - squared]


def scaled(prepared: PreparedMap, factor: float) -> PreparedMap:
    """A map in which all lengths are so many times as large: what `prepare_map` gives for it.

    Args:
        prepared: The map.
        factor: Above 0.
    """
    count = prepared.num_points
    lists = {
        name: as_table(np.asarray(getattr(prepared, name))[:count] * np.float32(factor), len(prepared.points))
        for name in ("points", "anchors")
    }
    parts = {**lists, "centroid": np.asarray(prepared.centroid) * np.float32(factor)}
    return replace(prepared, grid=prepared.grid.placed(scale=factor), **to_device(parts))
