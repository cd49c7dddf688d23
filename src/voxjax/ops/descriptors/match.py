"""Mutual nearest neighbours between two sets of descriptors, by pieces of a matrix product."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._runtime.placement import are_numpy, on_host
from ..._runtime.precision import in_full_precision
from ..._runtime.threads import spread
from ..._types import Array

_ROWS, _COLUMNS = 512, 1024
"""Sizes of a block on a CPU: smaller ones cost more calls, larger ones memory that is given back and cleared again."""
_APART = 1e30
"""Squared distance to rows that take no part; infinity would not survive a product with 0."""


@refused_after_fork
def mutual_nearest(
    descriptors_a: Float[Array, "n d"],
    descriptors_b: Float[Array, "m d"],
    mask_a: Bool[Array, "n"],
    mask_b: Bool[Array, "m"],
) -> tuple[Int[Array, "n"], Bool[Array, "n"], Float[Array, "n"]]:
    """Match descriptors that are each other's nearest; ties go to the lower row.

    NumPy arrays are compared block by block on a CPU, which takes n m / 64 bytes, and elsewhere padded to a rung of
    `bucket_size`, so that other numbers of rows compile nothing. All else is one kernel (`mutual_nearest_kernel`).

    Args:
        descriptors_a: Float (n, d), of squared norms far below 1e30; float32 where they are NumPy arrays.
        descriptors_b: Float (m, d).
        mask_a: Rows of a that take part.
        mask_b: Rows of b that take part.

    Returns:
        For each row of a: its nearest row of b, int32; whether that row's nearest is this one; and the
        squared distance between the two, at least 0. Where nothing takes part, the first row and not mutual. NumPy
        arrays where NumPy arrays were given.
    """
    given = descriptors_a, descriptors_b, mask_a, mask_b
    if not are_numpy(given):
        return mutual_nearest_kernel(*given)
    if on_host():
        return _mutual_nearest_on_host(*(np.asarray(array) for array in given))
    count, sizes = (
        len(descriptors_a),
        [bucket_size(len(rows), 512) for rows in (descriptors_a, descriptors_b)],
    )
    padded = (pad_rows(np.asarray(rows), size) for rows, size in zip(given, 2 * sizes, strict=True))
    nearest, is_mutual, square = (np.asarray(rows)[:count] for rows in mutual_nearest_kernel(*padded))
    return nearest, is_mutual, square


def _mutual_nearest_on_host(
    a: np.ndarray, b: np.ndarray, mask_a: np.ndarray, mask_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest rows of each block and the least of its columns; the blocks are merged in their order."""
    n, m = len(a), len(b)
    left, right = _factors(a, mask_a, _ROWS, is_left=True), _factors(b, mask_b, _COLUMNS, is_left=False)

    # All columns for some rows: the best so far stays with them, and only one block of squares is held.
    def run(first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        rows = left[first : first + _ROWS]
        nearest, least = np.zeros(_ROWS, np.int32), np.full(_ROWS, np.inf, np.float32)
        # A column to which no row of this block is the nearest keeps -1, which is no row's number.
        row_of_b, least_of_b = np.full(len(right), -1, np.int32), np.empty(len(right), np.float32)
        for start in range(0, len(right), _COLUMNS):
            square = np.asarray(_squares(rows, right[start : start + _COLUMNS]))
            column = square.argmin(axis=1)
            value = np.take_along_axis(square, column[:, None], axis=1)[:, 0]
            # Strictly less: of equally near columns the first one stays.
            closer = value < least
            nearest[closer], least[closer] = column[closer] + start, value[closer]
            square.min(axis=0, out=least_of_b[start : start + _COLUMNS])
            # Only rows to which a column is the nearest can be mutual to it; the lowest of them is written last.
            both = np.flatnonzero(value == least_of_b[start + column])[::-1]
            row_of_b[start + column[both]] = first + both
        return nearest, least, row_of_b, least_of_b

    parts = spread(run, range(0, len(left), _ROWS))
    row_of_b, least_of_b = np.full(len(right), -1, np.int32), np.full(len(right), np.inf, np.float32)
    # Strictly less, and parts in the order of their rows: ties go to the lower row, however many cores there are.
    for _, _, row, value in parts:
        closer = value < least_of_b
        row_of_b[closer], least_of_b[closer] = row[closer], value[closer]
    nearest = np.concatenate([np.zeros(0, np.int32), *(part[0] for part in parts)])[:n]
    square = np.concatenate([np.zeros(0, np.float32), *(part[1] for part in parts)])[:n]
    # Rows that take no part are `_APART` or twice as much away, and others far less than half of it. Without rows of b
    # there is nothing to look up.
    takes_part = mask_a & (square < 0.5 * _APART) if m else np.zeros(n, bool)
    is_mutual = takes_part & (row_of_b[nearest] == np.arange(n)) if m else takes_part
    return nearest, is_mutual, np.maximum(square, 0.0)


def _factors(descriptors: np.ndarray, mask: np.ndarray, block: int, *, is_left: bool) -> np.ndarray:
    """Rows whose products are squared distances: (x, 1, |x|^2) and (-2 y, |y|^2, 1), padded to whole blocks."""
    # Rows that take no part may hold anything, NaN too: zeros stand for them, and the norm sets them apart.
    values = np.where(mask[:, None], descriptors, 0).astype(np.float32)
    norm = np.where(mask, np.sum(values * values, axis=1, dtype=np.float32), np.float32(_APART))[:, None]
    one = np.ones_like(norm)
    rows = np.concatenate([values, one, norm] if is_left else [-2 * values, norm, one], axis=1)
    padded = pad_rows(rows, -(-len(rows) // block) * block)
    # Padding is as far from everything as rows that take no part.
    padded[len(rows) :, -1 if is_left else -2] = _APART
    padded[len(rows) :, -2 if is_left else -1] = 1.0
    return padded


@jax.jit
@in_full_precision
def _squares(left: Float[Array, "r k"], right: Float[Array, "c k"]) -> Float[Array, "r c"]:
    """Products of all rows."""
    return left @ right.T


@partial(jax.jit, static_argnames=("chunk",))
@in_full_precision
def mutual_nearest_kernel(
    descriptors_a: Float[Array, "n d"],
    descriptors_b: Float[Array, "m d"],
    mask_a: Bool[Array, "n"],
    mask_b: Bool[Array, "m"],
    *,
    chunk: int = 64,
) -> tuple[Int[Array, "n"], Bool[Array, "n"], Float[Array, "n"]]:
    """`mutual_nearest` as one kernel, `chunk` rows of a compared with all of b at once."""
    n, dtype = descriptors_a.shape[0], descriptors_a.dtype
    num_chunks = max(-(-n // chunk), 1)
    padding = num_chunks * chunk - n
    # Here norms are added and never multiplied, so that infinity marks the rows that take no part.
    norm_a = jnp.where(mask_a, jnp.sum(descriptors_a**2, axis=1, dtype=dtype), jnp.inf)
    norm_b = jnp.where(mask_b, jnp.sum(descriptors_b**2, axis=1, dtype=dtype), jnp.inf)
    rows = jnp.pad(descriptors_a, ((0, padding), (0, 0))).reshape(num_chunks, chunk, -1)
    norms = jnp.pad(norm_a, (0, padding), constant_values=jnp.inf).reshape(num_chunks, chunk)

    def compare(best_b: tuple[Array, Array], block: tuple[Array, Array, Array]):
        first, a, norm = block
        square = norm[:, None] + norm_b[None] - 2.0 * (a @ descriptors_b.T)
        least_of_b = jnp.min(square, axis=0)
        row_of_b = first + _first_at(square, least_of_b[None], axis=0)
        # Strictly less, for blocks come in the order of their rows: ties go to the lower one.
        closer = least_of_b < best_b[0]
        best_b = (jnp.where(closer, least_of_b, best_b[0]), jnp.where(closer, row_of_b, best_b[1]))
        least_of_a = jnp.min(square, axis=1)
        return best_b, (_first_at(square, least_of_a[:, None], axis=1), least_of_a)

    start = (jnp.full(norm_b.shape, jnp.inf, dtype), jnp.full(norm_b.shape, -1, jnp.int32))
    firsts = chunk * jnp.arange(num_chunks, dtype=jnp.int32)
    (_, row_of_b), (nearest, square) = jax.lax.scan(compare, start, (firsts, rows, norms))
    nearest, square = nearest.reshape(-1)[:n], square.reshape(-1)[:n]
    is_mutual = mask_a & jnp.isfinite(square) & (row_of_b[nearest] == jnp.arange(n, dtype=jnp.int32))
    # A square taken apart into a product and two norms may round to less than 0.
    return nearest, is_mutual, jnp.maximum(square, 0.0)


def _first_at(values: Array, least: Array, *, axis: int) -> Array:
    """Lowest index along `axis` where `values` equals `least`; quicker than argmin on a CPU."""
    size = values.shape[axis]
    index = jax.lax.broadcasted_iota(jnp.int32, values.shape, axis)
    return jnp.minimum(jnp.min(jnp.where(values <= least, index, size), axis=axis), size - 1)
