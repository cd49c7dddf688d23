"""Compaction: the list of occupied voxels of a dense grid, on the device, in a shape known in advance.

`jnp.nonzero(size=)` sums one count per voxel; here one per group of 64 voxels. The grid is packed into words, the
population counts of the groups give the slot where each group's voxels start, a maximum over the slots before carries
the group to its other slots, and the k-th set bit of a group is found by halving it.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int32, UInt8

from ..._checks import InputError
from ..._runtime.forks import refused_after_fork
from ..._types import Array
from ..bits import SPREAD, pack_spread

_GROUP = 4
"""Words of 16 voxels in a group: fewer mean more groups to mark, more mean more halving at each slot."""


@refused_after_fork
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
    # Places are counted in int32.
    max_voxels = 2**31 - 1
    if isinstance(size, bool) or int(size) != size or size < 0:
        raise InputError(f"size must be a whole number of rows, 0 or more, got {size!r}.")
    if occupied.size > max_voxels:
        raise InputError(
            f"occupied must have fewer than 2**31 voxels, got shape {occupied.shape}: use tiles."
        )
    size = int(size)
    if size == 0 or occupied.size == 0:
        return jnp.zeros((size, 3), jnp.int32), jnp.zeros(size, jnp.bool_)
    place, mask = _flat_indices(jnp.asarray(occupied).reshape(-1), size)
    return _unravel(place, occupied.shape), mask


def _flat_indices(bits: Array, size: int) -> tuple[jax.Array, jax.Array]:
    """Places of the first `size` set bits, 0 where there are fewer, and the mask of those that are there."""
    # A window of as many slots as a group has voxels, in two windows of 8: 16 comparisons a slot instead of 64.
    steps = 8, 8
    words = pack_spread(bits, _GROUP)
    counts = jax.lax.population_count(words).astype(jnp.int32).reshape(-1, _GROUP)
    per_group = sum((counts[:, k] for k in range(1, _GROUP)), counts[:, 0])
    last = _running_sum(per_group)
    first = last - per_group
    # Each group with a voxel writes its number at its first slot. Numbers grow, so the largest one among as many slots
    # as a group can fill is that of the slot's own group. Groups without a voxel write past the end, which is dropped.
    slot_of_group = jnp.where(per_group > 0, first, size)
    number = jnp.arange(len(per_group), dtype=jnp.int32)
    group = jnp.zeros(size, jnp.int32).at[slot_of_group].set(number, mode="drop")
    stride = 1
    for width in steps:
        group = _over_last(group, width, stride, jax.lax.max)
        stride *= width

    slot = jnp.arange(size, dtype=jnp.int32)
    place = SPREAD * _GROUP * group + _select_bit(words, _GROUP * group, slot - _take(first, group))
    # Slots past the last voxel find a place, too, in some group; they are told by their number.
    mask = slot < last[-1]
    return jnp.where(mask, place, 0), mask


def _running_sum(values: Array) -> jax.Array:
    """Inclusive sum of int32 in blocks of 64: XLA's own is several times slower on one long axis (CPU)."""
    short = -len(values) % 64
    padded = jnp.concatenate([values, jnp.zeros(short, jnp.int32)]) if short else values
    # The window of 64 that ends at an entry holds the whole row before it, and so its sum is the running sum. Two
    # windows of 8 make it, as above.
    inner = _over_last(_over_last(padded.reshape(-1, 64), 8, 1, jax.lax.add), 8, 8, jax.lax.add)
    if len(inner) > 1:
        # The last entry of a row is the sum of the row; the running sum of these is what each following row lacks.
        outer = _running_sum(inner[:, -1])
        inner += jnp.concatenate([jnp.zeros(1, jnp.int32), outer[:-1]])[:, None]
    return inner.reshape(-1)[: len(values)]


def _over_last(values: Array, width: int, stride: int, combine: Callable[[Array, Array], Array]) -> jax.Array:
    """Combine each int32 of the last axis with those 1 to `width` - 1 strides before it; 0 before the first."""
    before = (1,) * (values.ndim - 1)
    return jax.lax.reduce_window(
        values,
        jnp.int32(0),
        combine,
        (*before, width),
        (*before, 1),
        [*((0, 0) for _ in before), ((width - 1) * stride, 0)],
        window_dilation=(*before, stride),
    )


def _select_bit(words: Array, start: Array, rank: Array) -> jax.Array:
    """Find which of the 64 voxels from word `start` on is the occupied one that has `rank` occupied ones before it."""
    parts = [_take(words, start + k) for k in range(_GROUP)]
    counts = [jax.lax.population_count(part).astype(jnp.int32) for part in parts]
    place = jnp.zeros_like(rank)
    # Halve the words until one is left: the voxel is in the high half if the low one has no more than `rank`.
    while len(parts) > 1:
        half = len(parts) // 2
        below = sum(counts[1:half], counts[0])
        is_above = rank >= below
        rank = jnp.where(is_above, rank - below, rank)
        place += jnp.where(is_above, jnp.int32(SPREAD * half), jnp.int32(0))
        parts, counts = (
            [jnp.where(is_above, high, low) for low, high in zip(of[:half], of[half:], strict=True)]
            for of in (parts, counts)
        )
    word = parts[0]
    # Four bits of each byte are voxels: halves of 16 and 8 bits hold 8 and 4 of them.
    for width, num_voxels in ((16, 8), (8, 4), (2, 2), (1, 1)):
        low = word & jnp.uint32((1 << width) - 1)
        below = jax.lax.population_count(low).astype(jnp.int32)
        is_above = rank >= below
        rank = jnp.where(is_above, rank - below, rank)
        word = jnp.where(is_above, word >> jnp.uint32(width), low)
        place += jnp.where(is_above, jnp.int32(num_voxels), jnp.int32(0))
    return place


def _take(values: Array, index: Array) -> jax.Array:
    """Values at indices that are all in range."""
    return jnp.asarray(values).at[index].get(mode="promise_in_bounds")


def _unravel(place: Array, shape: tuple[int, ...]) -> jax.Array:
    """C-order indices (n, 3) of flat places."""
    # No place is negative: `//` would look after signs, at a price.
    row = jax.lax.div(place, jnp.int32(shape[2]))
    x = jax.lax.div(row, jnp.int32(shape[1]))
    # Without the barrier the whole search would be computed again for each column.
    x, y, z = jax.lax.optimization_barrier((x, row - x * shape[1], place - row * shape[2]))
    column = jnp.arange(3, dtype=jnp.int32)[None]
    return jnp.where(column == 0, x[:, None], jnp.where(column == 1, y[:, None], z[:, None]))
