"""Window counts on the occupied blocks of a grid only: for maps that are mostly empty.

A map of N occupied voxels touches some N / 20 blocks of 8 x 8 x 8 voxels, however large the box around it. Blocks are
cut from the grid's bits together with a halo, counted on their own, and stay in a list: what is wanted at single
voxels is looked up in it, and `dense_from_blocks` is the only way back to a dense grid.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int32, Shaped, UInt16, UInt32

from ..._checks import InputError, check_odd_window
from ..._runtime.buckets import bucket_size
from ..._runtime.forks import refused_after_fork
from ..._types import Array
from ..bits import WORD
from ..window.classes import MAX_SIZE
from .compact import occupied_indices
from .words import BLOCK, Words, lattice_of_words, occupied_blocks

MAX_HALO = BLOCK
"""Widest halo [voxel]: the margin of the words; enough for the largest window."""


class Blocks(NamedTuple):
    """Blocks of a grid, in lexicographic order, padded to a capacity.

    Attributes:
        words: uint32 (k, s, s) with s = 8 + 2 halo: bit b of words[n, i, j] is the voxel at
            8 index[n] - halo + (i, j, b), 0 beyond the grid and in padding rows.
        index: int32 (k, 3): place in the lattice of blocks; voxel (0, 0, 0) of block (i, j, k) is (8 i, 8 j, 8 k).
            Padding rows lie past the lattice.
        mask: bool (k,): False for padding rows.
        num_found: int32 scalar: blocks that the grid has; larger than k where the list was too short.
    """

    words: UInt32[jax.Array, "k s s"]
    index: Int32[jax.Array, "k 3"]
    mask: Bool[jax.Array, "k"]
    num_found: Int32[jax.Array, ""]

    @property
    def halo(self) -> int:
        """Voxels that each block's words hold beyond the block on every side."""
        return (self.words.shape[1] - BLOCK) // 2


@refused_after_fork
def list_blocks(words: Words, *, halo: int = 3) -> Blocks:
    """List the occupied blocks of a grid of bits; the list is as long as it must be, on the ladder of sizes.

    Host code: the number of blocks is read back. `cut_blocks` is the part that can be jitted.

    Args:
        words: Grid packed by `pack_words`.
        halo: Voxels to hold beyond each block, 0 to 8; half the window that is to be counted.

    Returns:
        `Blocks`, none of them missing.

    Raises:
        InputError: If the halo is out of range.
    """
    flags = occupied_blocks(words)
    count = int(jnp.sum(flags, dtype=jnp.int32))
    return cut_blocks(words, flags, halo=halo, capacity=bucket_size(count))


@refused_after_fork
@partial(jax.jit, static_argnames=("halo", "capacity"))
def cut_blocks(words: Words, flags: Bool[Array, "bx by bz"], *, halo: int, capacity: int) -> Blocks:
    """Cut the flagged blocks out of a grid of bits.

    Args:
        words: Grid packed by `pack_words`.
        flags: True for the blocks to cut, over the lattice of `lattice_of_words(words)`; `occupied_blocks` or others.
        halo: Voxels to hold beyond each block, 0 to 8.
        capacity: Length of the list.

    Returns:
        `Blocks`; where `num_found` is larger than `capacity`, the last blocks are missing.

    Raises:
        InputError: If the halo is out of range or the flags are not those of this grid.
    """
    lattice = lattice_of_words(words)
    if not 0 <= halo <= MAX_HALO:
        raise InputError(f"halo must be 0 to {MAX_HALO} voxels, got {halo}.")
    if flags.shape != lattice:
        raise InputError(f"flags must have the shape of the lattice of blocks {lattice}, got {flags.shape}.")
    # The lattice is a grid of flags like any other, and its blocks come in C order.
    listed, mask = occupied_indices(flags, size=capacity)
    # Rows left over lie outside, so that writes to them are dropped.
    index = jnp.where(mask[:, None], listed, jnp.asarray(lattice, jnp.int32)[None, :])
    num_found = jnp.sum(flags, dtype=jnp.int32)
    if 0 in lattice:
        # The words of an empty grid are margin alone, which may be smaller than the slice of one block.
        side = BLOCK + 2 * halo
        return Blocks(jnp.zeros((capacity, side, side), jnp.uint32), index, mask, num_found)
    cut = _cut(jnp.asarray(words), listed, halo)
    return Blocks(jnp.where(mask[:, None, None], cut, np.uint32(0)), index, mask, num_found)


def _cut(words: jax.Array, index: jax.Array, halo: int) -> jax.Array:
    """Columns of `8 + 2 halo` bits around each block, joined of the two words that they may straddle.

    A slice for each block is several times faster on CPU than an index for each word.
    """
    side = BLOCK + 2 * halo
    # The margin of the words, one block along x and y and one word along z, holds the widest halo: no
    # start is negative.
    corner = BLOCK * index[:, :2] + np.int32(BLOCK - halo)
    bit = BLOCK * index[:, 2] + np.int32(WORD - halo)

    def two_words(corner: jax.Array, word: jax.Array) -> jax.Array:
        # A column is 24 bits at most and begins within the first word, so it ends in the second one at the latest.
        return jax.lax.dynamic_slice(words, (corner[0], corner[1], word), (side, side, 2))

    # Behind the barrier each slice is cut once, though both of its words are read below.
    pairs = jax.lax.optimization_barrier(jax.vmap(two_words)(corner, bit // WORD))
    shift = (bit % WORD).astype(jnp.uint32)[:, None, None]
    # A shift by a whole word is not defined, hence the high part in two steps.
    joined = (pairs[..., 0] >> shift) | ((pairs[..., 1] << np.uint32(1)) << (np.uint32(WORD - 1) - shift))
    return joined & np.uint32((1 << side) - 1)


@refused_after_fork
@partial(jax.jit, static_argnames=("size",))
def count_in_blocks(blocks: Blocks, *, size: int = 7) -> UInt16[Array, "k 8 8 8"]:
    """`box_count` on listed blocks: the count of every voxel of each of them, exactly.

    Windows along z are counted in the bits, four voxels to a word; x and y are then plain sums over the list, some
    0.5 us a block on one core of a CPU, whatever the size of the grid.

    Args:
        blocks: Blocks from `list_blocks` or `cut_blocks`, with a halo of at least `size // 2`.
        size: Window edge [voxel]; odd, 1 to 15.

    Returns:
        uint16 in [0, size**3]; 0 in padding rows.

    Raises:
        InputError: If `size` is no window size, or the halo of the blocks is too narrow for it.
    """
    size = check_odd_window("size", size)
    reach = size // 2
    if size > MAX_SIZE:
        raise InputError(f"size must be at most {MAX_SIZE} voxels, got {size}.")
    if blocks.halo < reach:
        raise InputError(f"size must be at most 2 * halo + 1 = {2 * blocks.halo + 1} voxels, got {size}.")
    spare = blocks.halo - reach
    side = BLOCK + 2 * reach
    # Blocks may have been cut with a wider halo than this window needs; along z the surplus is shifted out.
    rows = blocks.words[:, spare : spare + side, spare : spare + side] >> np.uint32(spare)
    return count_cubes(rows, edge=BLOCK, size=size)


def count_cubes(rows: UInt32[Array, "k s s"], *, edge: int, size: int) -> UInt16[Array, "k e e e"]:
    """Counts of windows in cubes of bits, cut out with half a window around them.

    Args:
        rows: Words of cubes of `edge + 2 (size // 2)` voxels, at most 32, one word a column along z; bits above are not
            looked at.
        edge: Edge of the cubes that are counted [voxel], a multiple of 4.
        size: Window edge [voxel]; odd, 1 to 15.
    """
    # z and y are summed in the bytes of words, four voxels at a time: fewer bytes to move than a count for each voxel.
    fours = [_sum_along(_count_along_z(rows, first, size), 1, size) for first in range(0, edge, 4)]
    together = jax.lax.optimization_barrier(jnp.stack(fours, axis=-1))
    # Four counts of one byte in each word, in the order of z; two summed axes hold at most 225, the third needs uint16.
    counts = jax.lax.bitcast_convert_type(together, jnp.uint8).reshape(-1, edge, rows.shape[2], edge)
    return _sum_along(counts.astype(jnp.uint16), 2, size)


def _count_along_z(rows: Array, first: int, size: int) -> Array:
    """Counts of the windows of four voxels along z, `first` and the next three, as the bytes of a word."""
    window = np.uint32((1 << size) - 1)
    counts = [
        jax.lax.population_count((rows >> np.uint32(first + j)) & window) << np.uint32(8 * j)
        for j in range(4)
    ]
    return jax.lax.optimization_barrier(counts[0] | counts[1] | counts[2] | counts[3])


def _sum_along(terms: Array, axis: int, size: int) -> Array:
    """Sums of `size` neighbours along one axis where all of them are there, built from sums of 1, 2, 4, 8."""
    length = terms.shape[axis] - size + 1
    # Sums of 1, 2, 4 and 8 terms come by doubling; those that the binary digits of `size` name are joined end to end.
    total, start, width = None, 0, 1
    while True:
        if size & width:
            part = jax.lax.slice_in_dim(terms, start, start + length, axis=axis)
            total = part if total is None else total + part
            start += width
        if width * 2 > size:
            return jax.lax.optimization_barrier(total)
        left = jax.lax.slice_in_dim(terms, 0, terms.shape[axis] - width, axis=axis)
        terms = left + jax.lax.slice_in_dim(terms, width, terms.shape[axis], axis=axis)
        width *= 2


@refused_after_fork
@partial(jax.jit, static_argnames=("lattice",))
def take_from_blocks(
    values: Shaped[Array, "k 8 8 8"],
    blocks: Blocks,
    index: Int32[Array, "n 3"],
    *,
    lattice: tuple[int, int, int],
) -> tuple[Shaped[Array, "n"], Bool[Array, "n"]]:
    """Look values up at voxels.

    Args:
        values: One value for each voxel of each block.
        blocks: The list that the values belong to.
        index: Voxels.
        lattice: Lattice of the grid's blocks, `lattice_of_words(words)`.

    Returns:
        Values in the order of `index`, and whether each one's block is in the list; 0 where it is not.
    """
    # Flat places and shifts: several times faster on CPU than indices of three axes, which are checked one by one.
    count = lattice[0] * lattice[1] * lattice[2]
    listed = jnp.arange(blocks.mask.shape[0], dtype=jnp.int32)
    place = jnp.where(blocks.mask, _flat_place(blocks.index, lattice), count)
    # Rows of padding have a place past the end, which is dropped. An empty grid keeps one entry, for lookups to read.
    rows = jnp.full((max(count, 1),), -1, jnp.int32).at[place].set(listed, mode="drop")
    # The shift rounds down, for negative indices as well, so that these stay outside.
    block = jnp.asarray(index) >> np.int32(3)
    is_inside = jnp.all((block >= 0) & (block < jnp.asarray(lattice, jnp.int32)[None, :]), axis=1)
    row = rows.at[jnp.where(is_inside, _flat_place(block, lattice), 0)].get(mode="promise_in_bounds")
    is_listed = is_inside & (row >= 0)
    within = jnp.asarray(index) & np.int32(BLOCK - 1)
    inner = (within[:, 0] << np.int32(6)) | (within[:, 1] << np.int32(3)) | within[:, 2]
    at = jnp.where(is_listed, row * np.int32(BLOCK**3) + inner, 0)
    found = jnp.asarray(values).reshape(-1).at[at].get(mode="promise_in_bounds")
    return jnp.where(is_listed, found, jnp.zeros((), found.dtype)), is_listed


def _flat_place(index: jax.Array, lattice: tuple[int, int, int]) -> jax.Array:
    """Places in C order over the lattice."""
    return (index[:, 0] * np.int32(lattice[1]) + index[:, 1]) * np.int32(lattice[2]) + index[:, 2]


@refused_after_fork
@partial(jax.jit, static_argnames=("shape",))
def dense_from_blocks(
    values: Shaped[Array, "k 8 8 8"], blocks: Blocks, *, shape: tuple[int, int, int]
) -> Shaped[Array, "x y z"]:
    """A dense grid of the values of the listed blocks, 0 elsewhere.

    It costs more than a dense count would have: for tests, pictures and files.

    Args:
        values: One value for each voxel of each block.
        blocks: The list that the values belong to.
        shape: Size of the grid [voxel].
    """
    bx, by, bz = (-(-side // BLOCK) for side in shape)
    dense = jnp.zeros((bx, BLOCK, by, BLOCK, bz, BLOCK), values.dtype)
    i, j, k = blocks.index.T
    # Rows of padding lie past the lattice, and so do blocks that fill the last word along z: both are dropped.
    dense = dense.at[i, :, j, :, k, :].set(values, mode="drop")
    return dense.reshape(bx * BLOCK, by * BLOCK, bz * BLOCK)[: shape[0], : shape[1], : shape[2]]
