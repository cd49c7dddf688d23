"""Rigid motions as plain (4, 4) matrices: exp, log, inverse, adjoint, action.

Tangent vectors are (translation, rotation), metres and radians. `T_a_b` maps points of frame b into frame a. Results
have the dtype of the input and its accuracy. First derivatives, forward and reverse, are right at the identity too and
finite everywhere; at a half-turn, where `log` jumps, they are those of one of its sides.

`inverse` and `nearest_rotation` keep NumPy arrays on the host: stages that chain float64 poses, or solve thousands of
tiny problems inside a search, lose no digits and compile nothing. Inside kernels both take JAX arrays.
"""

import functools
import math
from collections.abc import Sequence
from typing import overload

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ._runtime.forks import refused_after_fork
from ._types import Array

# The default precision of a float32 product is lower on some devices.
_matmul = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


@refused_after_fork
def hat(omega: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """Return the skew matrix of `omega`, so that `hat(w) @ v = w x v`."""
    x, y, z = omega[..., 0], omega[..., 1], omega[..., 2]
    zero = jnp.zeros_like(x)
    rows = [jnp.stack(r, axis=-1) for r in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return jnp.stack(rows, axis=-2)


def _series_coefficients(angle_sq: Array) -> tuple[Array, Array, Array]:
    """Return sin t / t, (1 - cos t) / t^2 and (t - sin t) / t^3 as smooth functions of t^2, also at zero."""
    # Taylor series near zero, where the quotients lose digits. float64 leaves no error on either side of its bound, in
    # derivatives neither; float32 takes fewer terms, good to rounding.
    bound, num_terms = (1.0, 10) if angle_sq.dtype == jnp.float64 else (1e-2, 3)
    is_small = angle_sq < bound
    angle_sq_safe = jnp.where(is_small, jnp.ones_like(angle_sq), angle_sq)
    # Both branches of a `where` are computed and differentiated; in the one that is not taken, a division by zero would
    # turn the derivative of the other into NaN. Hence the safe denominators, here and below.
    t = jnp.sqrt(angle_sq_safe)
    quotients = jnp.sin(t) / t, (1.0 - jnp.cos(t)) / angle_sq_safe, (t - jnp.sin(t)) / (angle_sq_safe * t)
    a, b, c = (
        jnp.where(
            is_small, _taylor(angle_sq, [1 / math.factorial(2 * k + n) for k in range(num_terms)]), quotient
        )
        for n, quotient in enumerate(quotients, 1)
    )
    return a, b, c


def _inverse_jacobian_coefficient(angle_sq: Array, a: Array, b: Array) -> Array:
    """Return (1 - t / 2 / tan(t / 2)) / t^2 of an angle up to pi, from its first two series coefficients."""
    is_small = angle_sq < 1.0
    angle_sq_safe = jnp.where(is_small, jnp.ones_like(angle_sq), angle_sq)
    # The quotient is (b - a / 2) / (t^2 b). Written so, it is finite up to a half-turn, where tan(t / 2) is not.
    series = _taylor(angle_sq, [k / math.factorial(2 * k + 2) for k in range(1, 10)])
    return jnp.where(is_small, series, (b - 0.5 * a) / angle_sq_safe) / b


def _taylor(x: Array, coefficients: Sequence[float]) -> Array:
    """Alternating power series: c[0] - c[1] x + c[2] x^2 - ..."""
    total = jnp.full_like(x, coefficients[0])
    for k, coefficient in enumerate(coefficients[1:], 1):
        total = total + (-1) ** k * coefficient * x**k
    return total


def _identity_like(matrices: Array) -> Array:
    return jnp.broadcast_to(jnp.eye(3, dtype=matrices.dtype), matrices.shape)


@refused_after_fork
def exp_so3(omega: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """Rotation matrix of a rotation vector [rad]; smooth at zero."""
    a, b, _ = _series_coefficients(jnp.sum(omega * omega, axis=-1))
    skew = hat(omega)
    return _identity_like(skew) + a[..., None, None] * skew + b[..., None, None] * _matmul(skew, skew)


@refused_after_fork
def exp(tangent: Float[Array, "*batch 6"]) -> Float[Array, "*batch 4 4"]:
    """Pose of a tangent vector (translation [m], rotation [rad])."""
    v, omega = tangent[..., :3], tangent[..., 3:]
    a, b, c = _series_coefficients(jnp.sum(omega * omega, axis=-1))
    skew = hat(omega)
    skew_sq = _matmul(skew, skew)
    identity = _identity_like(skew)
    rotation = identity + a[..., None, None] * skew + b[..., None, None] * skew_sq
    left_jacobian = identity + b[..., None, None] * skew + c[..., None, None] * skew_sq
    return from_rotation_translation(rotation, _matmul(left_jacobian, v[..., None])[..., 0])


@refused_after_fork
def log_so3(rotation: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3"]:
    """Rotation vector [rad] of a rotation matrix, angle in [0, pi]; goes through the quaternion."""
    m00, m11, m22 = rotation[..., 0, 0], rotation[..., 1, 1], rotation[..., 2, 2]
    # Four candidates for 4 * q * (one component); the one with the largest square is well conditioned.
    squares = jnp.stack(
        [1.0 + m00 + m11 + m22, 1.0 + m00 - m11 - m22, 1.0 - m00 + m11 - m22, 1.0 - m00 - m11 + m22], axis=-1
    )
    r = rotation
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    candidates = jnp.stack(
        [
            jnp.stack([squares[..., 0], wx, wy, wz], axis=-1),
            jnp.stack([wx, squares[..., 1], xy, xz], axis=-1),
            jnp.stack([wy, xy, squares[..., 2], yz], axis=-1),
            jnp.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    # All four are made and one is taken, so that a batch needs no branches.
    best = jnp.argmax(squares, axis=-1)
    q = jnp.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / jnp.linalg.norm(q, axis=-1, keepdims=True)
    # q and -q are the same rotation; the one with w >= 0 has its angle in [0, pi].
    q = jnp.where(q[..., :1] < 0.0, -q, q)
    w, v = q[..., 0], q[..., 1:]
    return v * _angle_over_sine(jnp.sum(v * v, axis=-1), w)[..., None]


def _angle_over_sine(norm_sq: Array, w: Array) -> Array:
    """Rotation angle over the length of the vector part of a unit quaternion (w, v), w >= 0; smooth at v = 0."""
    # As in `_series_coefficients`: float64 takes terms until none is left.
    bound, num_terms = (1e-2, 8) if w.dtype == jnp.float64 else (1e-8, 1)
    is_small = norm_sq < bound
    norm_safe = jnp.sqrt(jnp.where(is_small, jnp.ones_like(norm_sq), norm_sq))
    w_safe = jnp.where(is_small, w, jnp.ones_like(w))
    series = _taylor(norm_sq / w_safe**2, [1 / (2 * k + 1) for k in range(num_terms)])
    return jnp.where(is_small, 2.0 * series / w_safe, 2.0 * jnp.arctan2(norm_safe, w) / norm_safe)


@refused_after_fork
def log(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 6"]:
    """Tangent vector (translation [m], rotation [rad]) of a pose; inverse of `exp` for angles below pi."""
    omega = log_so3(T[..., :3, :3])
    angle_sq = jnp.sum(omega * omega, axis=-1)
    a, b, _ = _series_coefficients(angle_sq)
    d = _inverse_jacobian_coefficient(angle_sq, a, b)
    skew = hat(omega)
    inverse_left_jacobian = _identity_like(skew) - 0.5 * skew + d[..., None, None] * _matmul(skew, skew)
    v = _matmul(inverse_left_jacobian, T[..., :3, 3:])[..., 0]
    return jnp.concatenate([v, omega], axis=-1)


@refused_after_fork
def from_rotation_translation(
    rotation: Float[Array, "*batch 3 3"], translation: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 4 4"]:
    """Pose matrix of a rotation and a translation [m]."""
    top = jnp.concatenate([rotation, translation[..., None]], axis=-1)
    bottom = jnp.broadcast_to(jnp.asarray([0.0, 0.0, 0.0, 1.0], top.dtype), (*top.shape[:-2], 1, 4))
    return jnp.concatenate([top, bottom], axis=-2)


@overload
def inverse(T: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]: ...
@overload
def inverse(T: Float[jax.Array, "*batch 4 4"]) -> Float[jax.Array, "*batch 4 4"]: ...
def inverse(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """Inverse pose, by transposition: `T_b_a` of `T_a_b`; a NumPy array gives a NumPy array."""
    if isinstance(T, np.ndarray):
        inverse = np.zeros_like(T)
        inverse[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
        # The bottom row is written, not inverted: it stays exact however many poses are chained.
        inverse[..., :3, 3] = -np.einsum("...ij,...j->...i", inverse[..., :3, :3], T[..., :3, 3])
        inverse[..., 3, 3] = 1.0
        return inverse
    rotation_t = jnp.swapaxes(T[..., :3, :3], -1, -2)
    return from_rotation_translation(rotation_t, -_matmul(rotation_t, T[..., :3, 3:])[..., 0])


@overload
def nearest_rotation(matrix: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]: ...
@overload
def nearest_rotation(matrix: Float[jax.Array, "*batch 3 3"]) -> Float[jax.Array, "*batch 3 3"]: ...
def nearest_rotation(matrix: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3 3"]:
    """Proper rotation R with the largest `trace(R.T @ matrix)`: the nearest one; never a reflection.

    Of the covariance `sum a b^T` of matched directions it is the R that brings b onto a with the least squared error
    (orthogonal Procrustes). A NumPy array gives a NumPy array.
    """
    xp = np if isinstance(matrix, np.ndarray) else jnp
    u, _, vt = xp.linalg.svd(matrix)
    # Where the nearest orthogonal matrix is a reflection, the axis of the smallest singular value costs least to turn.
    sign = xp.where(xp.linalg.det(xp.matmul(u, vt)) < 0.0, -1.0, 1.0).astype(u.dtype)
    last = sign[..., None, None] * u[..., 2:]
    return (np.matmul if xp is np else _matmul)(xp.concatenate([u[..., :2], last], axis=-1), vt)


@refused_after_fork
def adjoint(T: Float[Array, "*batch 4 4"]) -> Float[Array, "*batch 6 6"]:
    """Matrix that moves tangents through a pose: `exp(adjoint(T) @ x) = T @ exp(x) @ inverse(T)`.

    A covariance of left tangents, `exp(x) @ pose`, moves to another frame or centre as `A @ covariance @ A.T`.
    """
    rotation = T[..., :3, :3]
    # Translation comes first in tangents, so that the coupling with rotation is in the upper right block.
    top = jnp.concatenate([rotation, _matmul(hat(T[..., :3, 3]), rotation)], axis=-1)
    return jnp.concatenate([top, jnp.concatenate([jnp.zeros_like(rotation), rotation], axis=-1)], axis=-2)


@refused_after_fork
def apply(T: Float[Array, "4 4"], points: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Points [m] moved by the pose: `p_a = T_a_b @ p_b`."""
    moved = _matmul(points, jnp.swapaxes(T[:3, :3], 0, 1))
    # Everything runs under rank_promotion='raise', so that broadcasts are written out.
    return moved + jnp.broadcast_to(T[:3, 3], moved.shape)
