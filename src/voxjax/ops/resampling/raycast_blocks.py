"""Maps of rays in boxes of any size: rays that lie near each other are cast in a box of their own."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float64, Int64, UInt8

from ..._checks import InputError
from ..._runtime.buckets import wide_bucket_size
from ..._runtime.memory import check_memory
from ..._types import FREE, OCCUPIED
from ..blocks.block_array import BLOCK_VOXELS, BlockArray, Shape, lattice_shape
from ..blocks.block_builder import BlockBuilder, split
from ..blocks.windows import TILE
from ..blocks.words import BLOCK
from .lattice import MAX_VOXELS
from .raycast import crossed_voxels


def states_of_rays(
    starts: Float64[np.ndarray, "n 3"],
    ends: Float64[np.ndarray, "n 3"],
    is_hit: Bool[np.ndarray, " n"],
    shape: Shape,
    *,
    low: Int64[np.ndarray, "3"],
    advice: str,
    most: int = TILE,
) -> BlockArray:
    """States of a box: occupied where rays hit, free where they cross it else, start and end included.

    Each ray is cast as in a dense box (`crossed_voxels`), to the same bits. The time follows the rays, and the memory
    the blocks that they cross.

    Args:
        starts: Places [voxel] in the box.
        ends: Likewise.
        is_hit: Whether the voxel of each end is occupied.
        shape: Number of voxels along x, y, z.
        low: The box's lowest voxel.
        advice: What to do where the memory does not suffice, for the message.
        most: Voxels of the boxes in which rays are cast, about; more where a single ray needs more.

    Raises:
        InputError: If the memory does not suffice, or the box of a single ray has more voxels than int32 counts.
    """
    index = np.stack([np.floor(places).astype(np.int64) - low for places in (starts, ends)])
    # Boxes begin and end at borders of blocks, so that what is found in them are blocks of the whole.
    begin, end = index.min(axis=0) // BLOCK, index.max(axis=0) // BLOCK + 1
    longest = BLOCK_VOXELS * int((end - begin).prod(axis=1).max(initial=1))
    if longest > MAX_VOXELS // 2:
        raise InputError(
            f"the box of a ray must have at most {MAX_VOXELS // 2:,} voxels, got one of {longest:,}; {advice}."
        )
    # One length for all boxes: each other one would be compiled.
    most = wide_bucket_size(min(max(most, 2 * longest), MAX_VOXELS // 2), 2**18)
    # A mask on the device and what is copied of it, as of a dense box.
    check_memory(5.0 * most, f"boxes of {most:,} voxels, in which rays are cast,", advice)
    lattice = lattice_shape(shape)
    numbers, bits = [np.zeros(0, np.int64)], [np.zeros((0, BLOCK_VOXELS // 8), np.uint8)]
    for rays in _near_each_other(begin, end, most // BLOCK_VOXELS):
        first, last = begin[rays].min(axis=0), end[rays].max(axis=0)
        sides = (BLOCK * (last - first)).tolist()
        box = (sides[0], sides[1], sides[2])
        crossed = crossed_voxels(starts[rays], ends[rays], box, low=low + BLOCK * first, capacity=most)
        places, blocks = split(crossed)
        numbers.append(np.asarray(np.ravel_multi_index(tuple((places + first).T), lattice)))
        # One bit a voxel: a block is crossed in many boxes.
        bits.append(np.packbits(blocks.reshape(-1, BLOCK_VOXELS), axis=1))
    crossed = _joined(np.concatenate(numbers), np.concatenate(bits))
    return _states(*crossed, index[1][is_hit], shape, advice)


def _near_each_other(
    begin: Int64[np.ndarray, "n 3"], end: Int64[np.ndarray, "n 3"], most: int
) -> Iterator[Int64[np.ndarray, " m"]]:
    """Groups of rays whose common box has at most so many blocks; each ray alone has fewer."""
    left = [np.arange(len(begin))]
    while left:
        rays = left.pop()
        extent = end[rays].max(axis=0) - begin[rays].min(axis=0)
        if extent.prod() <= most:
            yield rays
            continue
        # Halves by the middles of the rays, along the axis over which these spread most.
        middle = begin[rays] + end[rays]
        axis = int(np.argmax(np.ptp(middle, axis=0)))
        order = np.argsort(middle[:, axis], kind="stable")
        left += [rays[order[len(rays) // 2 :]], rays[order[: len(rays) // 2]]]


def _joined(
    numbers: Int64[np.ndarray, " m"], bits: UInt8[np.ndarray, "m 64"]
) -> tuple[Int64[np.ndarray, " k"], UInt8[np.ndarray, "k 64"]]:
    """Each block once, crossed where it is in any of the boxes."""
    if not len(numbers):
        return numbers, bits
    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    is_first = np.append(True, numbers[1:] != numbers[:-1])
    words = bits[order].view(np.uint64)
    return numbers[is_first], np.bitwise_or.reduceat(words, np.flatnonzero(is_first), axis=0).view(np.uint8)


def _states(
    numbers: Int64[np.ndarray, " k"],
    bits: UInt8[np.ndarray, "k 64"],
    hits: Int64[np.ndarray, "h 3"],
    shape: Shape,
    advice: str,
) -> BlockArray:
    """Blocks of free voxels, and of occupied ones, which are crossed, too."""
    lattice = lattice_shape(shape)
    # Which of the blocks each hit lies in, in their order.
    row = np.searchsorted(numbers, np.asarray(np.ravel_multi_index(tuple((hits // BLOCK).T), lattice)))
    order = np.argsort(row, kind="stable")
    row, place = row[order], hits[order] % BLOCK
    is_mixed = (bits != 255).any(axis=1)
    is_mixed[row] = True
    num_mixed = int(is_mixed.sum())
    what = f"a grid of {num_mixed:,} blocks of 8 x 8 x 8 voxels"
    check_memory(1.0 * BLOCK_VOXELS * num_mixed, what, advice, on_device=False)
    builder = BlockBuilder(shape, np.uint8, capacity=num_mixed + 1)
    index = np.stack(np.unravel_index(numbers, lattice), axis=1)
    # Few at a time: what is unpacked stays in the cache.
    step = 1 << 12
    for start in range(0, len(numbers), step):
        blocks = (FREE * np.unpackbits(bits[start : start + step], axis=1)).reshape(-1, BLOCK, BLOCK, BLOCK)
        some = slice(*np.searchsorted(row, [start, start + step]))
        blocks[(row[some] - start, *place[some].T)] = OCCUPIED
        builder.add(index[start : start + step], blocks)
    return builder.finish()
