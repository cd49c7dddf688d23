"""Mutual nearest neighbours between two sets of descriptors, by chunks of a matrix product."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from .._types import Array

_CHUNK = 64
"""Rows compared at once; 64 x 20,000 distances stay in the cache of a core."""


@partial(jax.jit, static_argnames=("chunk",))
def mutual_nearest(
    descriptors_a: Float[Array, "n d"],
    descriptors_b: Float[Array, "m d"],
    mask_a: Bool[Array, "n"],
    mask_b: Bool[Array, "m"],
    *,
    chunk: int = _CHUNK,
) -> tuple[Int[Array, "n"], Bool[Array, "n"], Float[Array, "n"]]:
    """Match descriptors that are each other's nearest; ties go to the lower row.

    Args:
        descriptors_a: Float (n, d).
        descriptors_b: Float (m, d).
        mask_a: Rows of a that take part.
        mask_b: Rows of b that take part.
        chunk: Rows of a compared with all of b at once.

    Returns:
        For each row of a: its nearest row of b, int32; whether that row's nearest is this one; and the
        squared distance between the two, at least 0.
    """
    n, dtype = descriptors_a.shape[0], descriptors_a.dtype
    num_chunks = max(-(-n // chunk), 1)
    padding = num_chunks * chunk - n
    norm_a = jnp.where(mask_a, jnp.sum(descriptors_a**2, axis=1, dtype=dtype), jnp.inf)
    norm_b = jnp.where(mask_b, jnp.sum(descriptors_b**2, axis=1, dtype=dtype), jnp.inf)
    rows = jnp.pad(descriptors_a, ((0, padding), (0, 0))).reshape(num_chunks, chunk, -1)
    norms = jnp.pad(norm_a, (0, padding), constant_values=jnp.inf).reshape(num_chunks, chunk)

    def compare(best_b: tuple[Array, Array], block: tuple[Array, Array, Array]):
        first, a, norm = block
        square = norm[:, None] + norm_b[None] - 2.0 * (a @ descriptors_b.T)
        least_of_b = jnp.min(square, axis=0)
        row_of_b = first + _first_at(square, least_of_b[None], axis=0)
        closer = least_of_b < best_b[0]
        best_b = (jnp.where(closer, least_of_b, best_b[0]), jnp.where(closer, row_of_b, best_b[1]))
        least_of_a = jnp.min(square, axis=1)
        return best_b, (_first_at(square, least_of_a[:, None], axis=1), least_of_a)

    start = (jnp.full(norm_b.shape, jnp.inf, dtype), jnp.full(norm_b.shape, -1, jnp.int32))
    firsts = chunk * jnp.arange(num_chunks, dtype=jnp.int32)
    (_, row_of_b), (nearest, square) = jax.lax.scan(compare, start, (firsts, rows, norms))
    nearest, square = nearest.reshape(-1)[:n], square.reshape(-1)[:n]
    is_mutual = mask_a & jnp.isfinite(square) & (row_of_b[nearest] == jnp.arange(n, dtype=jnp.int32))
    return nearest, is_mutual, jnp.maximum(square, 0.0)


def _first_at(values: Array, least: Array, *, axis: int) -> Array:
    """Lowest index along `axis` where `values` equals `least`; quicker than argmin on a CPU."""
    size = values.shape[axis]
    index = jax.lax.broadcasted_iota(jnp.int32, values.shape, axis)
    return jnp.minimum(jnp.min(jnp.where(values <= least, index, size), axis=axis), size - 1)
