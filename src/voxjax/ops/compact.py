"""Compaction: the list of occupied voxels of a dense grid, on the device, in a shape known in advance.

`jnp.nonzero(size=)` sums one count per voxel; here one per group of 128 voxels. The grid is packed into words of 32
bits, the population counts of the groups give the slot where each group's voxels start, a running maximum carries the
group to its slots, and the k-th set bit of a word is found by halving it.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int32, UInt8, UInt32

from .._checks import InputError
from .._types import Array

_BITS = 32
_GROUP = 4  # words; 2 to 8 are within a tenth of each other on CPU
_MAX_VOXELS = 2**31 - 1


@partial(jax.jit, static_argnames=("size",))
def occupied_indices(
    occupied: Bool[Array, "x y z"] | UInt8[Array, "x y z"], *, size: int
) -> tuple[Int32[Array, "k 3"], Bool[Array, "k"]]:
    """List the occupied voxels in C order, padded or cut to `size` rows.

    The rows that hold are those of `np.argwhere(occupied)[:size]`.

    Args:
        occupied: True (or not 0) where a voxel is occupied; fewer than 2**31 voxels.
        size: Number of rows, known before the call; 0 or more. Voxels beyond it are left out: no more than `size`
            were there only if some row is left over or the caller counted them.

    Returns:
        int32 (size, 3) voxel indices, (0, 0, 0) in the rows left over, and the mask of the rows that hold.

    Raises:
        InputError: If `size` is not a whole number from 0, or the grid has 2**31 voxels or more.
    """
    if isinstance(size, bool) or int(size) != size or size < 0:
        raise InputError(f"size must be a whole number of rows, 0 or more, got {size!r}.")
    if occupied.size > _MAX_VOXELS:
        raise InputError(
            f"occupied must have fewer than 2**31 voxels, got shape {occupied.shape}: use tiles."
        )
    size = int(size)
    if size == 0 or occupied.size == 0:
        return jnp.zeros((size, 3), jnp.int32), jnp.zeros(size, jnp.bool_)
    place, mask = _flat_indices(jnp.asarray(occupied).astype(jnp.bool_).reshape(-1), size)
    return _unravel(place, occupied.shape), mask


def pack_bits(bits: Bool[Array, "n"], multiple: int = 1) -> UInt32[Array, "m"]:
    """Pack bits into words of 32, the first bit lowest, zeros appended up to a multiple of `multiple` words."""
    short = -len(bits) % (_BITS * multiple)
    if short:
        bits = jnp.concatenate([jnp.asarray(bits), jnp.zeros(short, jnp.bool_)])
    weight = jnp.left_shift(jnp.uint32(1), jnp.arange(_BITS, dtype=jnp.uint32))[None]
    return jnp.sum(jnp.where(bits.reshape(-1, _BITS), weight, jnp.uint32(0)), axis=1, dtype=jnp.uint32)


def _flat_indices(bits: Array, size: int) -> tuple[jax.Array, jax.Array]:
    """Places of the first `size` set bits, 0 where there are fewer, and the mask of those that are there."""
    words = pack_bits(bits, _GROUP).reshape(-1, _GROUP)
    counts = jax.lax.population_count(words).astype(jnp.int32)
    per_group = jnp.sum(counts, axis=1, dtype=jnp.int32)
    last = _blockwise(per_group, jax.lax.cumsum, jnp.add)
    first = last - per_group
    # Each group with a voxel writes its number at its first slot; the running maximum fills the slots after it.
    slot_of_group = jnp.where(per_group > 0, first, size)
    number = jnp.arange(len(words), dtype=jnp.int32)
    marks = jnp.zeros(size, jnp.int32).at[slot_of_group].set(number, mode="drop")
    group = jax.lax.optimization_barrier(_blockwise(marks, jax.lax.cummax, jnp.maximum))

    slot = jnp.arange(size, dtype=jnp.int32)
    row, rank = words[group], slot - first[group]
    word, which = row[:, 0], jnp.zeros(size, jnp.int32)
    for k in range(_GROUP - 1):
        count = jax.lax.population_count(word).astype(jnp.int32)
        is_later = (which == k) & (rank >= count)
        rank = jnp.where(is_later, rank - count, rank)
        word = jnp.where(is_later, row[:, k + 1], word)
        which = jnp.where(is_later, k + 1, which)
    place = _BITS * (group * _GROUP + which) + _select_bit(word, rank)
    mask = slot < last[-1]
    return jnp.where(mask, place, 0), mask


def _blockwise(values: Array, scan, combine) -> jax.Array:
    """Inclusive scan of int32 >= 0 in blocks of 64: XLA's own is several times slower on one long axis (CPU)."""
    short = -len(values) % 64
    padded = jnp.concatenate([values, jnp.zeros(short, jnp.int32)]) if short else values
    inner = scan(padded.reshape(-1, 64), axis=1)
    outer = scan(inner[:, -1], axis=0)
    before = jnp.concatenate([jnp.zeros(1, jnp.int32), outer[:-1]])
    return combine(inner, before[:, None]).reshape(-1)[: len(values)]


def _select_bit(word: Array, rank: Array) -> jax.Array:
    """Place of the set bit that has `rank` set bits below it."""
    place = jnp.zeros_like(rank)
    for width in (16, 8, 4, 2, 1):
        low = word & jnp.uint32((1 << width) - 1)
        count = jax.lax.population_count(low).astype(jnp.int32)
        is_above = rank >= count
        rank = jnp.where(is_above, rank - count, rank)
        word = jnp.where(is_above, word >> jnp.uint32(width), low)
        place = place + jnp.where(is_above, jnp.int32(width), jnp.int32(0))
    return place


def _unravel(place: Array, shape: tuple[int, ...]) -> jax.Array:
    """C-order indices (n, 3) of flat places."""
    row = jax.lax.div(place, jnp.int32(shape[2]))
    x = jax.lax.div(row, jnp.int32(shape[1]))
    # Without the barrier the whole search would be computed again for each column.
    x, y, z = jax.lax.optimization_barrier((x, row - x * shape[1], place - row * shape[2]))
    column = jnp.arange(3, dtype=jnp.int32)[None]
    return jnp.where(column == 0, x[:, None], jnp.where(column == 1, y[:, None], z[:, None]))
