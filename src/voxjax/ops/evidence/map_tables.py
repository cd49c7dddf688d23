"""The pools of one map that lookups share: nearest voxels, states and evidence codes, by blocks, with one table.

Blocks that no voxel is near look alike where their states do, and share a row; every other one has a row of its own, so
that memory follows the surface and not the box. Tables and pools have the few lengths of `_runtime.tables`, so that
maps share compiled kernels; what follows the map in them is never looked up, and its content means nothing. Work is
done in slabs in NumPy (`nearest_host`) or by one kernel (`nearest`, `scoring`), tile by tile; the cells of the map hold
the same bits either way.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int, Int32, UInt8, UInt32

from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.placement import on_host, to_device
from ..._runtime.tables import as_table, pool_lengths, reserve
from ..._runtime.threads import num_cores, spread
from ..._types import Array
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.windows import TILE, cut_tiles, tile_rows
from ..blocks.words import BLOCK
from .nearest import INDEX_BITS, NOTHING_NEAR, nearest_field
from .nearest_host import evidence_codes_on_host, nearest_field_on_host
from .scoring import evidence_codes


class MapPools(NamedTuple):
    """Nearest voxels and states of a map, by blocks.

    Attributes:
        table: Row of the pools of each block of the box, in C order.
        keys: Pool of `nearest_field` of all occupied voxels; 512 cells a row.
        states: Pool of the states, as long.
        num_rows: Rows of the pools that stand for a block of the box.
        num_shared: Rows of blocks that no voxel is near; those that follow stand for one block each, in C order.
    """

    table: Int32[Array, "blocks"]
    keys: UInt32[Array, "cells"]
    states: UInt8[Array, "cells"]
    num_rows: int
    num_shared: int


def map_pools(
    states: BlockArray, index: Int32[np.ndarray, "n 3"], *, radius: int, tile: int = TILE
) -> MapPools:
    """Pools of a map.

    Args:
        states: States of the map.
        index: Its occupied voxels, in C order.
        radius: Reach of the nearest voxels [voxel], 1 to 5.
        tile: Voxels that are worked on at once, about.

    Returns:
        Device arrays of the lengths that `pool_lengths` gives.

    Raises:
        InputError: If the radius, the number of voxels or that of blocks near them does not fit what kernels count.
    """
    known, pool = np.asarray(states.table).reshape(-1), np.asarray(states.pool)
    near = blocks_near(index, states.table.shape, radius=radius)
    # Blocks that nothing is near have a row for each row of the states; row 0 stays that of the unknown.
    is_shared = states.uses > np.bincount(known[near], minlength=len(pool))
    is_shared[0] = True
    shared = np.flatnonzero(is_shared)
    num_rows = len(shared) + len(near)
    num_blocks, length = pool_lengths(len(known), num_rows, len(index))[:2]

    keys, held = (
        reserve(length, BLOCK_VOXELS, dtype=np.uint32),
        reserve(length, BLOCK_VOXELS, dtype=pool.dtype),
    )
    keys[: len(shared)] = NOTHING_NEAR
    _fill_keys(keys[len(shared) : num_rows], near, index, states.shape, radius, tile)
    flat = pool.reshape(len(pool), BLOCK_VOXELS)
    np.take(flat, shared, axis=0, out=held[: len(shared)])
    np.take(flat, known[near], axis=0, out=held[len(shared) : num_rows])

    table, row_of = reserve(num_blocks, dtype=np.int32), np.zeros(len(pool), np.int32)
    row_of[shared] = np.arange(len(shared), dtype=np.int32)
    # Where all is unknown the table stays as the system gives it, and takes no memory.
    filled = np.flatnonzero(known)
    table[filled] = row_of[known[filled]]
    table[near] = np.arange(len(shared), num_rows, dtype=np.int32)
    table, keys, held = to_device((table, keys.reshape(-1), held.reshape(-1)))
    return MapPools(table, keys, held, num_rows, len(shared))


def code_pool(
    states: UInt8[Array, "cells"], keys: UInt32[Array, "cells"], num_rows: int, *, hit_sq: int, clear_sq: int
) -> UInt8[Array, "cells"]:
    """`evidence_codes` of a map, as a pool.

    Args:
        states: Pool of the map's states.
        keys: Pool of its nearest voxels.
        num_rows: Rows that the pools begin with and that stand for a block.
        hit_sq: Squared distance [voxel^2] up to which something occupied is a hit.
        clear_sq: Squared distance [voxel^2] from which on a free voxel is well clear of anything occupied.

    Returns:
        Device array as long as the pools given.
    """
    if not on_host(states, keys):
        return evidence_codes(states, keys, hit_sq, clear_sq)
    # What follows the map in its pools is left untouched, or it would take memory for nothing.
    held, near = (np.asarray(pool)[: num_rows * BLOCK_VOXELS] for pool in (states, keys))
    return to_device(evidence_codes_on_host(held, near, hit_sq, clear_sq, length=len(keys)))


def blocks_near(
    index: Int32[np.ndarray, "n 3"], lattice: tuple[int, ...], *, radius: int
) -> Int[np.ndarray, "m"]:
    """Blocks that may have a place up to `radius` from a voxel along each axis.

    Args:
        index: The voxels.
        lattice: Number of blocks of the box along x, y, z.
        radius: At most 8 [voxel].

    Returns:
        Their numbers in C order, ascending.
    """
    _, b, c = lattice
    number = ((index[:, 0] >> 3) * np.int64(b) + (index[:, 1] >> 3)) * c + (index[:, 2] >> 3)
    marked = reserve(int(np.prod(lattice, dtype=np.int64)), dtype=bool)
    marked[number] = True
    blocks = np.flatnonzero(marked)
    # Whether any voxel of a block reaches the block before it along an axis, and the one after it: of the 26 around,
    # those are marked that voxels reach along each axis, be it different ones.
    reached = []
    places = np.stack(np.unravel_index(blocks, lattice))
    for axis in range(3):
        within = index[:, axis] & 7
        for reaches, room in (
            (within < radius, places[axis] > 0),
            (within + radius >= BLOCK, places[axis] + 1 < lattice[axis]),
        ):
            side = reserve(len(marked), dtype=bool)
            side[number[reaches]] = True
            reached.append(side[blocks] & room)
    strides = b * c, c, 1
    for step in np.ndindex(3, 3, 3):
        around, shift = np.ones(len(blocks), bool), 0
        for axis, which in enumerate(step):
            if which:
                around &= reached[2 * axis + which - 1]
                shift += (2 * which - 3) * strides[axis]
        marked[blocks[around] + shift] = True
    return np.flatnonzero(marked)


def _fill_keys(
    rows: UInt32[np.ndarray, "m 512"],
    near: Int[np.ndarray, "m"],
    index: Int32[np.ndarray, "n 3"],
    shape: tuple[int, int, int],
    radius: int,
    tile: int,
) -> None:
    """Write the keys of blocks, by their numbers in C order."""
    if not len(near):
        return
    lattice = tuple(-(-n // BLOCK) for n in shape)
    blocks = np.stack(np.unravel_index(near, lattice), axis=1)
    for _, chosen in tile_rows(cut_tiles(shape, halo=0, most=tile), BLOCK * blocks):
        some = blocks[chosen]
        # Around the blocks there is a block more, in whole ones: cut out of the box, they stay blocks. The end may lie
        # beyond the box.
        low = np.maximum(some.min(axis=0) - 1, 0)
        high = np.minimum(some.max(axis=0) + 2, lattice)
        listed = _listed_in(index, BLOCK * low, BLOCK * high)
        keys = _keys_in(index[listed] - (BLOCK * low).astype(np.int32), high - low, some - low, radius)
        if not isinstance(listed, slice):
            # Rows of the part are in the order of those of the map, so that ties are broken alike.
            is_near = keys != NOTHING_NEAR
            own = keys[is_near]
            squared = own >> np.uint32(INDEX_BITS) << np.uint32(INDEX_BITS)
            keys[is_near] = squared | listed[own - squared].astype(np.uint32)
        rows[chosen] = keys
    # Nobody looks beyond the box, and what counts near cells must not find any there.
    cells = rows.reshape(-1, BLOCK, BLOCK, BLOCK)
    for axis, side in enumerate(shape):
        if side % BLOCK:
            at_end = np.flatnonzero(blocks[:, axis] == side // BLOCK)
            beyond = (slice(side % BLOCK, None) if axis == other else slice(None) for other in range(3))
            cells[(at_end, *beyond)] = NOTHING_NEAR


def _listed_in(
    index: Int32[np.ndarray, "n 3"], low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]
) -> Int[np.ndarray, "m"] | slice:
    """Rows of a list in C order that lie in a window."""
    first, last = np.searchsorted(index[:, 0], [low[0], high[0]])
    part = index[first:last, 1:]
    is_in = ((part >= low[1:]) & (part < high[1:])).all(axis=1)
    if len(part) == len(index) and is_in.all():
        return slice(None)
    return first + np.flatnonzero(is_in)


def _keys_in(
    index: Int32[np.ndarray, "n 3"],
    lattice: Int[np.ndarray, "3"],
    blocks: Int[np.ndarray, "m 3"],
    radius: int,
) -> UInt32[np.ndarray, "m 512"]:
    """Keys of some blocks of a box of whole blocks."""
    x, y, z = sides = tuple((BLOCK * lattice).tolist())
    if not on_host(index):
        # The device's kernel belongs to the lengths of its arguments.
        num_cells, num_rows = bucket_size(x * y * z, 1 << 20), bucket_size(len(index), 1 << 14)
        padded, mask = as_table(index, num_rows), np.arange(num_rows) < len(index)
        dims = np.asarray(sides, np.int32)
        field = nearest_field(padded, mask, dims, flat_size=num_cells, radius=radius)
        chosen = pad_rows(blocks.astype(np.int32), bucket_size(len(blocks), 1 << 11))
        return np.array(_blocks_at(field, dims, chosen)[: len(blocks)])
    field = nearest_field_on_host(index, sides, length=x * y * z, radius=radius)
    a, b, c = lattice.tolist()
    by_block = field.reshape(a, BLOCK, b, BLOCK, c, BLOCK).transpose(0, 2, 4, 1, 3, 5)
    keys = np.empty((len(blocks), BLOCK, BLOCK, BLOCK), np.uint32)

    def cut(part: slice) -> None:
        keys[part] = by_block[tuple(blocks[part].T)]

    step = -(-len(blocks) // num_cores())
    spread(cut, [slice(start, start + step) for start in range(0, len(blocks), step)])
    return keys.reshape(-1, BLOCK_VOXELS)


@jax.jit
def _blocks_at(field: Array, dims: Array, blocks: Array) -> Array:
    """Cells of some blocks of a dense field, (m, 512)."""
    x, y, z = (
        BLOCK * blocks[:, axis, None] + jnp.arange(BLOCK, dtype=jnp.int32)[None, :] for axis in range(3)
    )
    cell = (x[:, :, None] * dims[1] + y[:, None, :])[..., None] * dims[2] + z[:, None, None, :]
    return field[cell.reshape(len(blocks), -1)]
