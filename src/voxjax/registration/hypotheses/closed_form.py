"""Best rigid transform between matched points, in closed form (section IV.D)."""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ... import rigid
from ..._runtime.precision import in_full_precision
from ..._types import Array


def _centred(
    points: Float[Array, "n 3"], weights: Float[Array, "n"]
) -> tuple[Float[Array, "n 3"], Float[Array, "3"]]:
    """Points minus their weighted centroid, and the centroid, without loss for clouds far from the origin."""
    total = jnp.maximum(jnp.sum(weights, dtype=points.dtype), jnp.finfo(points.dtype).tiny)
    share = (weights / total)[:, None]
    # The first point that counts is near the others: sums of differences to it do not cancel.
    base = points[jnp.argmax(weights)]
    local = points - base[None, :]
    mean = jnp.sum(jnp.where(share > 0, local * share, 0.0), axis=0, dtype=points.dtype)
    # Padding may hold anything, also what is not finite: it is set to 0 rather than multiplied by a weight of
    # 0.
    return jnp.where(share > 0, local - mean[None, :], 0.0), base + mean


@jax.jit
@in_full_precision
def align_points(
    points_a: Float[Array, "n 3"], points_b: Float[Array, "n 3"], weights: Float[Array, "n"] | None = None
) -> Float[Array, "4 4"]:
    """Transform that brings matched points of b onto points of a with the least weighted squared error.

    Centred singular value decomposition; never a reflection. Points on one line, or fewer than three, do not
    fix the rotation: the result is then one of the best transforms (see `is_degenerate`).

    Args:
        points_a: Points in frame a [m].
        points_b: The points of frame b [m] that they match, row by row.
        weights: Weight of each match, at least 0; 0 leaves a row out (padding). None counts all rows once.

    Returns:
        `T_a_b` with `p_a = T_a_b @ p_b`, dtype of the points; the identity where no row counts.

    References:
        Section IV.D: the transform from the matched corners of the best scheme.
    """
    if weights is None:
        weights = jnp.ones(points_a.shape[0], dtype=points_a.dtype)
    weights = weights.astype(points_a.dtype)
    local_a, mean_a = _centred(points_a, weights)
    local_b, mean_b = _centred(points_b, weights)
    rotation = rigid.nearest_rotation(jnp.asarray((local_a * weights[:, None]).T @ local_b))
    T_a_b = rigid.from_rotation_translation(rotation, mean_a - rotation @ mean_b)
    # Without a weight there is no centroid either: a fixed pose is better than what rounding makes of zeros.
    return jnp.where(jnp.any(weights > 0), T_a_b, jnp.eye(4, dtype=points_a.dtype))


@jax.jit
@in_full_precision
def is_degenerate(points: Float[Array, "n 3"], weights: Float[Array, "n"] | None = None) -> Bool[Array, ""]:
    """Whether points that count are fewer than three or lie on one line, so that no rotation is fixed.

    Args:
        points: Points [m].
        weights: Weight of each point; 0 leaves a row out. None counts all rows once.
    """
    if weights is None:
        weights = jnp.ones(points.shape[0], dtype=points.dtype)
    weights = weights.astype(points.dtype)
    local, _ = _centred(points, weights)
    scatter = (local * weights[:, None]).T @ local
    eigenvalues = jnp.linalg.eigvalsh(scatter)
    too_few = jnp.sum(weights > 0, dtype=jnp.int32) < 3
    # A ratio of squared lengths: points whose second extent is a thousandth of the first lie on one line.
    return too_few | ~(eigenvalues[1] > 1e-6 * eigenvalues[2])
