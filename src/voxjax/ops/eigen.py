"""Closed-form eigen decomposition of symmetric 3x3 matrices, batched, with gradients that are finite everywhere.

`eigen_by_columns` takes the six entries as columns, which a CPU runs several times faster than matrices;
`symmetric_eigen` is the same for batches of matrices.
"""

import functools
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._runtime.forks import refused_after_fork
from .._runtime.placement import on_host
from .._runtime.precision import in_full_precision
from .._types import Array


class EigenColumns(NamedTuple):
    """Eigenvalues and eigenvectors, one row each, one column a matrix.

    Attributes:
        values: (3, *n), ascending.
        vectors: (3, 3, *n): row i is the unit vector of value i, its second axis x, y, z.
        is_defined: bool (3, *n): whether value i stands apart from the others by more than the tolerance, so that its
            vector is determined up to the sign; elsewhere it is some vector of an orthonormal basis.
    """

    values: Float[Array, "3 *n"]
    vectors: Float[Array, "3 3 *n"]
    is_defined: Bool[Array, "3 *n"]


@refused_after_fork
def eigen_by_columns(
    entries: Float[Array, "6 *n"], *, tolerance: float | Float[Array, ""] = 1e-3
) -> EigenColumns:
    """Decompose symmetric 3x3 matrices given by the columns of their entries.

    Derivatives are those of the decomposition where the values differ; where two differ by less than the tolerance,
    the turn between their vectors, which has no derivative there, is left out, so that gradients are finite
    everywhere, also at multiples of the identity.

    Args:
        entries: Rows xx, yy, zz, xy, xz, yz; scale is removed inside, so any unit will do.
        tolerance: Least difference of eigenvalues, as a share of the largest absolute one.

    Returns:
        `EigenColumns`, dtype of the entries.

    References:
        Smith, Eigenvalues of a symmetric 3x3 matrix, 1961, for the value that stands apart, its cosine taken from a
        polynomial; the other two from the 2x2 problem in the plane normal to its vector.
    """
    entries = jnp.asarray(entries)
    values, vectors = _decompose(entries, jnp.asarray(tolerance, entries.dtype))
    return EigenColumns(values, vectors, _stands_apart(values, jnp.asarray(tolerance, entries.dtype)))


@refused_after_fork
@jax.jit
def symmetric_eigen(matrix: Float[Array, "*n 3 3"]) -> tuple[Float[Array, "*n 3"], Float[Array, "*n 3 3"]]:
    """Eigenvalues (ascending) and eigenvectors of symmetric 3x3 matrices, by `eigen_by_columns`.

    Args:
        matrix: Symmetric matrices; what lies below the diagonal is not read.

    Returns:
        Values (*n, 3) and vectors (*n, 3, 3) whose row i belongs to value i; rows are orthonormal. Where two
        values coincide, some orthonormal basis of their plane is given.
    """
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    eigen = eigen_by_columns(jnp.stack([matrix[..., i, j] for i, j in pairs]))
    return jnp.moveaxis(eigen.values, 0, -1), jnp.moveaxis(eigen.vectors, (0, 1), (-2, -1))


def _stands_apart(values: Array, tolerance: Array) -> Bool[Array, "3 *n"]:
    """Whether each value differs from both others by more than the tolerance."""
    # Values ascend, so the largest magnitude is at one of the two ends.
    least = tolerance * jnp.maximum(jnp.abs(values[0]), jnp.abs(values[2]))
    is_low, is_high = values[1] - values[0] > least, values[2] - values[1] > least
    return jnp.stack([is_low, is_low & is_high, is_high])


@jax.custom_jvp
def _decompose(entries: Array, tolerance: Array) -> tuple[Array, Array]:
    return _decomposed(entries)


@_decompose.defjvp
@in_full_precision
def _decompose_jvp(
    primals: tuple[Array, Array], tangents: tuple[Array, Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """First-order perturbation; pairs of equal values do not turn against each other."""
    entries, tolerance = primals
    values, vectors = _decompose(entries, tolerance)
    xx, yy, zz, xy, xz, yz = tangents[0]
    change = jnp.stack([jnp.stack([xx, xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])])
    # In the basis of the vectors, the diagonal of the change moves the values. What is beside it turns one vector
    # toward another, the more the closer their values lie.
    inner = jnp.einsum("ia...,ab...,jb...->ij...", vectors, change, vectors)
    # A value has no gap to itself, so that the diagonal counts as tied and is no turn.
    gap = values[None, :] - values[:, None]
    scale = tolerance * jnp.maximum(jnp.abs(values[0]), jnp.abs(values[2]))
    is_apart = jnp.abs(gap) > scale[None, None]
    # Both sides of the division are guarded: a 0 / 0 that is not chosen would still be NaN in the next derivative.
    turn = jnp.where(is_apart, inner, 0) / jnp.where(is_apart, gap, 1)
    moved = jnp.einsum("ij...,ia...->ja...", turn, vectors)
    diagonal = jnp.stack([inner[k, k] for k in range(3)])
    return (values, vectors), (diagonal, moved)


@partial(jax.jit, inline=True)
def _decomposed(entries: Float[Array, "6 *n"]) -> tuple[Array, Array]:
    """Values (3, *n) and vectors (3, 3, *n); on a CPU in pieces whose columns fit the cache of a core."""
    # Matrices that a CPU decomposes at once.
    piece = 8192
    batch, flat = entries.shape[1:], entries.reshape(6, -1)
    length = flat.shape[1]
    if on_host() and length > piece:
        # Matrices of zeros pad the last piece: the guards against matrices without scale and spread keep them finite.
        rows = jnp.pad(flat, ((0, 0), (0, -length % piece))).reshape(6, -1, piece)
        found = jax.lax.map(_closed_form, jnp.moveaxis(rows, 1, 0))
        found = [jnp.moveaxis(a, 0, -2).reshape(*a.shape[1:-1], -1)[..., :length] for a in found]
    else:
        found = _closed_form(flat)
    values, vectors = found
    return values.reshape(3, *batch), vectors.reshape(3, 3, *batch)


def _closed_form(entries: Float[Array, "6 n"]) -> tuple[Float[Array, "3 n"], Float[Array, "3 3 n"]]:
    dtype = entries.dtype
    # Without scale, mean and spread the values are 2 cos of three angles a third of a turn apart (Smith), and products
    # of three entries neither overflow nor vanish in float32.
    scale = jnp.max(jnp.abs(entries), axis=0)
    scale_safe = jnp.where(scale > 0, scale, 1)
    xx, yy, zz, xy, xz, yz = (entries[k] / scale_safe for k in range(6))
    mean = (xx + yy + zz) / 3
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    spread = jnp.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    # Below this the rest is rounding: the matrix is a multiple of the identity.
    is_round = spread <= 4 * jnp.finfo(dtype).eps
    part = jnp.where(is_round, 0, 1 / jnp.where(is_round, 1, spread))
    xx, yy, zz, xy, xz, yz = (part * entry for entry in (xx, yy, zz, xy, xz, yz))
    half_det = (xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)) / 2
    # The value that stands apart is the largest where the determinant is positive, else the smallest. It is
    # twice the cosine of a third of the angle whose cosine is |half_det|, up to its sign, and a short polynomial in the
    # cosine of half that angle.
    is_high = half_det >= 0
    # Rounding may take the cosine past 1, hence the clip; the root is that of the cosine of half the angle.
    lone = _two_cosines(jnp.sqrt((1 + jnp.clip(jnp.abs(half_det), 0, 1)) / 2))
    lone = jnp.where(is_high, lone, -lone)
    # Less the value that stands apart the matrix has rank two, even where the other two values are equal: two of its
    # rows span the plane that this vector is normal to.
    x, y, z = _null_column(xx - lone, yy - lone, zz - lone, xy, xz, yz)
    # Two vectors normal to it, without a branch (Duff et al., Building an orthonormal basis, revisited, 2017).
    sign = jnp.where(z >= 0, jnp.ones_like(z), -jnp.ones_like(z))
    # With the sign of z the sum is never closer to 0 than 1.
    a = -1 / (sign + z)
    b = x * y * a
    u = (1 + sign * x * x * a, sign * b, -sign * x)
    v = (b, sign + y * y * a, -y)

    def form(p: tuple, q: tuple) -> Array:
        return (
            p[0] * (xx * q[0] + xy * q[1] + xz * q[2])
            + p[1] * (xy * q[0] + yy * q[1] + yz * q[2])
            + p[2] * (xz * q[0] + yz * q[1] + zz * q[2])
        )

    # The two values that may lie close together come from the 2 x 2 problem of their own plane, which one rotation
    # solves: their difference is computed as such, and not as that of two cosines.
    uu, vv, uv = form(u, u), form(v, v), form(u, v)
    middle, half = (uu + vv) / 2, (uu - vv) / 2
    radius = jnp.sqrt(half * half + uv * uv)
    # Where the two values coincide, any basis of their plane will do, and the one at hand is kept.
    is_turned = radius > jnp.finfo(dtype).tiny
    # Half the angle of (half, uv), from its cosine and sine.
    cos = jnp.where(is_turned, jnp.sqrt((1 + jnp.abs(half) / jnp.where(is_turned, radius, 1)) / 2), 1)
    # This cosine is at least the root of a half, so the sine is a quotient that nothing small divides.
    sin = uv / jnp.where(is_turned, 2 * radius * cos, 1)
    # With a negative `half` the whole angle is beyond a right one: its half has sine and cosine in each other's place.
    cos, sin = (
        jnp.where(half >= 0, cos, jnp.abs(sin)),
        jnp.where(half >= 0, sin, jnp.where(sin < 0, -cos, cos)),
    )
    large = tuple(cos * p + sin * q for p, q in zip(u, v, strict=True))
    small = tuple(cos * q - sin * p for p, q in zip(u, v, strict=True))
    first = (x, y, z)
    # No sort is needed: the value that stands apart is at one end, and the other two come in their order.
    ends = middle - radius, middle + radius
    values = (
        jnp.where(is_high, ends[0], lone),
        jnp.where(is_high, ends[1], ends[0]),
        jnp.where(is_high, lone, ends[1]),
    )
    # What was taken off is put back; the vectors are those of the whole matrix all along.
    values = tuple((value * spread + mean) * scale for value in values)
    vectors = tuple(
        tuple(jnp.where(is_high, p, q) for p, q in zip(one, other, strict=True))
        for one, other in ((small, first), (large, small), (first, large))
    )
    return jnp.stack(values), jnp.stack([jnp.stack(vector) for vector in vectors])


@functools.cache
def _cosine_coefficients() -> tuple[float, ...]:
    """Coefficients of 2 cos(2/3 arccos(s)) in (s - 0.85355) / 0.14645: smooth there, and good to 1e-12."""
    # At the nodes of Chebyshev the fit is nearly the best one of its degree over the whole range.
    nodes = np.cos(np.pi * (np.arange(13) + 0.5) / 13)
    values = 2 * np.cos(2 / 3 * np.arccos(np.clip(0.85355 + 0.14645 * nodes, -1.0, 1.0)))
    return tuple(float(c) for c in np.polynomial.Polynomial.fit(nodes, values, 12, domain=[-1, 1]).coef)


def _two_cosines(s: Array) -> Array:
    """2 cos(2/3 arccos(s)) for s in [sqrt(1/2), 1]: arccos and cos are scalar calls on a CPU, this is a vector loop."""
    t = (s - 0.85355) / 0.14645
    *lower, highest = _cosine_coefficients()
    total = jnp.full_like(s, highest)
    for coefficient in reversed(lower):
        total = total * t + coefficient
    return total


def _null_column(
    xx: Array, yy: Array, zz: Array, xy: Array, xz: Array, yz: Array
) -> tuple[Array, Array, Array]:
    """Unit vector in the null space of singular matrices: the longest cross product of two rows; z where all vanish."""
    a = (xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy)
    b = (yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz)
    c = (yz * xz - zz * xy, zz * xx - xz * xz, xz * xy - yz * xx)
    # Two of the rows may be parallel, or one may vanish: the longest product is that of the best pair.
    squares = [p[0] * p[0] + p[1] * p[1] + p[2] * p[2] for p in (a, b, c)]
    is_a = (squares[0] >= squares[1]) & (squares[0] >= squares[2])
    is_b = ~is_a & (squares[1] >= squares[2])
    square = jnp.maximum(jnp.maximum(squares[0], squares[1]), squares[2])
    is_defined = square > 1e-12
    length = jnp.sqrt(jnp.where(is_defined, square, 1))
    picked = [jnp.where(is_a, p, jnp.where(is_b, q, r)) / length for p, q, r in zip(a, b, c, strict=True)]
    x, y, z = (jnp.where(is_defined, p, e) for p, e in zip(picked, (0.0, 0.0, 1.0), strict=True))
    return x, y, z
