"""Kernels that say which associations can hold together: by distances, by frames, by normals.

They are for `consistency`, which gives them arrays of few lengths, and for whoever builds a graph inside a kernel.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32

from .._runtime.precision import in_full_precision
from .._types import Array


@jax.jit
@in_full_precision
def distance_consistency(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    associations: Int32[Array, "m 2"],
    distance_tolerance: Float[Array, ""] | np.float32,
    min_distance: Float[Array, ""] | np.float32,
) -> Bool[Array, "m m"]:
    """Equation (4) for all pairs of associations at once, and one-to-one.

    Args:
        nodes_a: Point of a of each association [m].
        nodes_b: Point of b of each association [m].
        associations: Index pairs; negative in padding rows.
        distance_tolerance: D of equation (4) [m].
        min_distance: Pairs nearer than this in either map are not compatible [m].
    """

    def distances(nodes: Array) -> Array:
        # Differences first, then squares: a Gram matrix would lose millimetres in float32.
        # One axis comes after the other: an array of all differences would be three times that of the distances.
        squared = jnp.zeros((nodes.shape[0], nodes.shape[0]), nodes.dtype)
        for axis in range(3):
            gap = nodes[:, axis][:, None] - nodes[:, axis][None, :]
            squared = squared + gap * gap
        return jnp.sqrt(squared)

    length_a, length_b = distances(nodes_a), distances(nodes_b)
    index_a, index_b = associations[:, 0], associations[:, 1]
    # The diagonal falls with it, as each association shares both corners with itself.
    shares_corner = (index_a[:, None] == index_a[None, :]) | (index_b[:, None] == index_b[None, :])
    is_real = index_a >= 0
    return (
        (jnp.abs(length_a - length_b) < distance_tolerance)
        & (jnp.minimum(length_a, length_b) >= min_distance)
        & ~shares_corner
        & is_real[:, None]
        & is_real[None, :]
    )


def _cyclic_rotations(frames_a: Array, frames_b: Array) -> Array:
    """Rotations (m, 3, 3, 3) that carry frame b onto frame a, one for each cyclic order of its rows."""
    # Both frames are right-handed: of six orders of the normals three are left.
    turned = jnp.stack([jnp.roll(frames_b, shift, axis=-2) for shift in range(3)], axis=-3)
    return jnp.einsum("mki,mskj->msij", frames_a, turned)


@jax.jit
@in_full_precision
def rotations_agree(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    frames_a: Float[Array, "m 3 3"],
    frames_b: Float[Array, "m 3 3"],
    edges: Int32[Array, "e 2"],
    angle_tolerance: Float[Array, ""] | np.float32,
) -> Bool[Array, "e"]:
    """Whether two associations imply one rotation, for some cyclic order of the normals of each.

    The trace of a relative rotation is `1 + 2 cos angle`; frames need not be exactly orthonormal. The nodes
    are not used: frames alone decide.
    """
    rotations = _cyclic_rotations(frames_a, frames_b)
    first, second = rotations[edges[:, 0]], rotations[edges[:, 1]]
    # The sum over both indices is the trace of R_1^T R_2, for each of the 3 x 3 choices of orders.
    trace = jnp.max(jnp.einsum("esij,etij->est", first, second), axis=(1, 2))
    # Scaled by the size of the implied matrices, so that slightly skew frames do not fail for their skew.
    norm = jnp.linalg.norm(rotations.reshape(rotations.shape[0], 3, 9), axis=-1)[:, 0]
    scale = 3.0 / jnp.maximum(norm[edges[:, 0]] * norm[edges[:, 1]], 1e-12)
    return trace * scale >= 1.0 + 2.0 * jnp.cos(angle_tolerance)


@jax.jit
@in_full_precision
def normals_agree(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    normals_a: Float[Array, "m 3"],
    normals_b: Float[Array, "m 3"],
    edges: Int32[Array, "e 2"],
    angle_tolerance: Float[Array, ""] | np.float32,
) -> Bool[Array, "e"]:
    """Whether two normals and the line through their points make the same angles in both maps."""

    def cosines(nodes: Array, normals: Array) -> Array:
        i, j = edges[:, 0], edges[:, 1]
        line = nodes[j] - nodes[i]
        line = line / jnp.maximum(jnp.linalg.norm(line, axis=-1, keepdims=True), 1e-9)
        pairs = ((normals[i], normals[j]), (normals[i], line), (normals[j], line))
        return jnp.stack([jnp.sum(u * v, axis=-1, dtype=u.dtype) for u, v in pairs], axis=-1)

    # Rounding may carry a cosine past 1, and the root below would be NaN.
    c = jnp.clip(cosines(nodes_a, normals_a), -1.0, 1.0)
    d = jnp.clip(cosines(nodes_b, normals_b), -1.0, 1.0)
    # cos(alpha - beta) without arc cosines.
    cosine_of_gap = c * d + jnp.sqrt((1.0 - c * c) * (1.0 - d * d))
    # The slack is some units in the last place of float32: angles that are equal may not fail for rounding.
    return jnp.all(cosine_of_gap >= jnp.cos(angle_tolerance) - 1e-6, axis=-1)
