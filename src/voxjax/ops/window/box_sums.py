"""Sums of 0 and 1 over the cube around each voxel, as whole-array passes that XLA compiles to vector loops.

Each form takes a bool grid and an odd size from 1 to 15, returns uint16 and counts what is outside the grid as empty.
`margin` widens the result by that many voxels on every side, for kernels that compare windows beyond the border.
"""

import jax
import jax.numpy as jnp

from ..._types import Array
from ..bits import WORD, pack_bits


def separable(is_occupied: Array, size: int, margin: int = 0) -> jax.Array:
    """One pass per axis in uint8, uint8, uint16, over a grid that gets its halo once.

    Temporary memory is one byte per voxel of the grid with its halo: the second sums lie in the result's memory.
    """
    halo = size // 2 + margin
    # `lax.pad` runs once, before the passes on CPU and within the first one on GPU.
    return sums_within(jax.lax.pad(is_occupied.astype(jnp.uint8), jnp.uint8(0), [(halo, halo, 0)] * 3), size)


def sums_within(ones: Array, size: int) -> jax.Array:
    """Sums over the windows that lie in a grid of 0 and 1, uint8, as a whole: `size` - 1 fewer along each axis."""
    return _sum_rows_and_planes(_sum_along(ones, 2, size, size), size)


def packed(is_occupied: Array, size: int, margin: int = 0) -> jax.Array:
    """Do what `separable` does, with the first sums as population counts of `size` bits of words that hold 32 voxels.

    The halo is added to the words, an eighth of the bytes: fewer bytes are moved, more operations are done.
    """
    halo = size // 2 + margin
    nx, ny, nz = is_occupied.shape
    num_words = -(-(nz + 2 * halo) // WORD)
    fill = WORD * num_words - nz - halo
    rows = jax.lax.pad(is_occupied, jnp.bool_(False), [(0, 0, 0), (0, 0, 0), (halo, fill, 0)])
    # The rows were filled up to whole words, so that no word has voxels of two of them.
    words = pack_bits(rows.reshape(-1)).reshape(nx, ny, num_words)
    # One word more at the end: the last windows take bits from it.
    words = jax.lax.pad(words, jnp.uint32(0), [(halo, halo, 0), (halo, halo, 0), (0, 1, 0)])
    first = jnp.arange(WORD, dtype=jnp.uint32)[None, None, None]
    here = jnp.right_shift(words[:, :, :-1, None], first)
    # In two steps, since no device need shift by 32.
    after = jnp.left_shift(jnp.left_shift(words[:, :, 1:, None], jnp.uint32(1)), jnp.uint32(WORD - 1) - first)
    bits = (here | after) & jnp.uint32((1 << size) - 1)
    counts = jax.lax.population_count(bits).astype(jnp.uint8).reshape(*words.shape[:2], WORD * num_words)
    return _sum_rows_and_planes(counts[:, :, : nz + 2 * margin], size)


def summed_area(is_occupied: Array, size: int, margin: int = 0) -> jax.Array:
    """Integral image and eight looked-up corners, one axis at a time, in uint32: work independent of `size`."""
    half = size // 2
    # Axis by axis: an entry sums one axis of windows, where one integral image would sum the whole grid.
    table: jax.Array = jnp.asarray(is_occupied, jnp.uint32)
    for axis in range(3):
        length = table.shape[axis] + 2 * margin
        pad = [(0, 0)] * 3
        # One zero more stands in front, so that the first window has a sum before it to take off, like all others.
        pad[axis] = (half + margin + 1, half + margin)
        sums = jnp.cumsum(jnp.pad(table, pad), axis=axis, dtype=jnp.uint32)
        high = jax.lax.slice_in_dim(sums, size, size + length, axis=axis)
        table = high - jax.lax.slice_in_dim(sums, 0, length, axis=axis)
    return table.astype(jnp.uint16)


def _sum_rows_and_planes(counts: Array, size: int) -> jax.Array:
    """Sum the sums along z over y and x; barriers keep XLA from doing one pass again for each term of the next."""
    # The sums over z and y are 15**2 at most and fit a byte; of those over x as many terms are added in
    # bytes as fit one.
    counts = _sum_along(jax.lax.optimization_barrier(counts), 1, size, size)
    return _sum_along(jax.lax.optimization_barrier(counts), 0, size, 255 // size**2).astype(jnp.uint16)


def _sum_along(counts: Array, axis: int, size: int, num_narrow: int) -> jax.Array:
    """Sums of `size` neighbours, `size` - 1 fewer than there were; the sum of `num_narrow` terms fits uint8.

    All terms are added in one loop. Sums of 1, 2 and 4 terms would need fewer additions, but one array more for
    each, and were 1.3 times slower (CPU, size 7).
    """
    length = counts.shape[axis] - size + 1
    terms = [jax.lax.slice_in_dim(counts, k, k + length, axis=axis) for k in range(size)]
    parts: list[jax.Array] = [
        sum(terms[k + 1 : k + num_narrow], terms[k]) for k in range(0, size, num_narrow)
    ]
    if len(parts) == 1:
        return parts[0]
    wide = [part.astype(jnp.uint16) for part in parts]
    return sum(wide[1:], wide[0])
