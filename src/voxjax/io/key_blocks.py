"""Blocks of a map on the lattice of an octree's keys, in the order in which a tree is written.

A map begins at any key, and so its own blocks lie between the nodes of the tree that are eight voxels wide. Each of
these nodes is put together from up to eight blocks. The cost is that of the blocks that hold something, whatever box
they span.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray
from ..ops.blocks.words import BLOCK


class KeyBlocks(NamedTuple):
    """Some nodes of a tree that are eight voxels wide.

    Attributes:
        code: int64 (n,): their numbers in Morton order, ascending (`morton_codes`).
        is_level: bool (n,): whether a node holds one value alone.
        level: (n,): a value of each node, which is the one of those that hold one alone.
        values: (m, 512): voxels of the other nodes, in Morton order too.
    """

    code: np.ndarray
    is_level: np.ndarray
    level: np.ndarray
    values: np.ndarray


def morton_codes(index: np.ndarray) -> np.ndarray:
    """Numbers int64 (n,) in Morton order of places (n, 3) below 65,536: bits of x, y, z in turn, those of x lowest."""
    code = np.zeros(len(index), np.int64)
    for axis in range(3):
        bits = index[:, axis].astype(np.int64)
        for shift, mask in (
            (16, 0x0000FF0000FF),
            (8, 0x00F00F00F00F),
            (4, 0x0C30C30C30C3),
            (2, 0x249249249249),
        ):
            bits = (bits | bits << shift) & mask  # spreads 16 bits to every third place
        code |= bits << axis
    return code


def places_of_codes(code: np.ndarray) -> np.ndarray:
    """Places int64 (n, 3) of numbers in Morton order."""
    places = np.empty((len(code), 3), np.int64)
    for axis in range(3):
        bits = code >> axis & 0x249249249249
        for shift, mask in (
            (2, 0x0C30C30C30C3),
            (4, 0x00F00F00F00F),
            (8, 0x0000FF0000FF),
            (16, 0x00000000FFFF),
        ):
            bits = (bits | bits >> shift) & mask
        places[:, axis] = bits
    return places


def key_block_codes(array: BlockArray, low: np.ndarray) -> np.ndarray:
    """Numbers int64 (n,) of the nodes that may hold something, ascending.

    Args:
        array: The map.
        low: int64 (3,): key of its voxel (0, 0, 0).
    """
    blocks = array.places()
    found = np.zeros(0, np.int64)
    # What reaches beyond the keys is unknown.
    most = (1 << 16) // BLOCK - 1
    for step in _steps(low):
        index = blocks + (low // BLOCK + step)
        found = np.union1d(found, morton_codes(index[((index >= 0) & (index <= most)).all(axis=1)]))
    return found


def key_blocks(array: BlockArray, low: np.ndarray, codes: np.ndarray) -> Iterator[KeyBlocks]:
    """Nodes of eight voxels with their values, some thousand at a time.

    Args:
        array: The map.
        low: int64 (3,): key of its voxel (0, 0, 0).
        codes: int64 (n,): their numbers, ascending.
    """
    # Where each voxel of a block stands in Morton order.
    order = np.ravel_multi_index(tuple(places_of_codes(np.arange(BLOCK_VOXELS)).T), (BLOCK,) * 3)
    pool, offset, count = np.asarray(array.pool), (low % BLOCK).tolist(), 1 << 12
    for start in range(0, len(codes), count):
        code = codes[start : start + count]
        place = places_of_codes(code) - low // BLOCK
        rows = {step: _rows_at(array, place - step) for step in _steps(low)}
        first = next(iter(rows.values()))
        is_level = array.is_uniform[first]
        for other in rows.values():
            is_level = is_level & (other == first)
        mixed = np.flatnonzero(~is_level)
        blocks = np.zeros((len(mixed), BLOCK, BLOCK, BLOCK), array.dtype)
        for step, row in rows.items():
            # A node begins within a block, or at its end: voxel o of the node is the first one of the next block.
            pairs = list(zip(step, offset, strict=True))
            source = tuple(slice(BLOCK - o, None) if s else slice(0, BLOCK - o) for s, o in pairs)
            target = tuple(slice(0, o) if s else slice(o, None) for s, o in pairs)
            blocks[(slice(None), *target)] = pool[(row[mixed], *source)]
        values = blocks.reshape(len(mixed), BLOCK_VOXELS)[:, order]
        yield KeyBlocks(code, is_level, pool[first, 0, 0, 0], values)


def _steps(low: np.ndarray) -> list[tuple[int, ...]]:
    """By how many blocks a node may lie behind those that it is put together from, along each axis."""
    return list(np.ndindex(*(2 if along % BLOCK else 1 for along in low.tolist())))


def _rows_at(array: BlockArray, place: np.ndarray) -> np.ndarray:
    """Rows of the pool for places of the table, 0 beyond it."""
    is_inside = ((place >= 0) & (place < array.table.shape)).all(axis=1)
    rows = np.zeros(len(place), np.int32)
    rows[is_inside] = np.asarray(array.table)[tuple(place[is_inside].T)]
    return rows
