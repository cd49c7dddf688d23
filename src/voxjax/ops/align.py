"""Point-to-plane alignment of many poses at once against the nearest-voxel field of a map."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float32, Int32, UInt32

from .. import rigid
from .._types import Array
from .evidence import lookup
from .nearest import NOTHING_NEAR, split_keys

DAMPING = 1e-4
"""Share of the mean diagonal added to the normal equations: directions that no surface fixes do not move."""


def point_to_plane_system(
    residual: Float32[Array, "n"], jacobian: Float32[Array, "n 6"], weight: Float32[Array, "n"]
) -> tuple[Float32[Array, "6 6"], Float32[Array, "6"]]:
    """Normal equations of weighted rows."""
    weighted = jacobian * weight[:, None]
    return weighted.T @ jacobian, weighted.T @ residual


@partial(jax.jit, static_argnames=("num_steps", "batch_size"))
def align_poses(
    keys: UInt32[Array, "flat"],
    dims: Int32[Array, "3"],
    origin: Float32[Array, "3"],
    voxel_size: Float32[Array, ""],
    surface: Float32[Array, "m 3"],
    normals: Float32[Array, "m 3"],
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    *,
    num_steps: int = 20,
    start_distance: Float32[Array, ""] | float = 5.0,
    final_distance: Float32[Array, ""] | float = 1.5,
    batch_size: int = 4,
) -> Float32[Array, "k 4 4"]:
    """Refine poses of points onto a voxel surface by iterated re-weighted point-to-plane steps.

    The robust scale shrinks geometrically over the first two thirds of the steps, so that a coarse pose is pulled in
    and furniture seen by one map only lets go at the end.

    Args:
        keys: Nearest-voxel field of the map, flat over `dims`.
        dims: Size of its block [voxel].
        origin: Its outer corner [m].
        voxel_size: [m].
        surface: Occupied voxel centres the keys point to [m].
        normals: Their unit normals.
        points: Points of the other map [m].
        weights: One a point; 0 for padding.
        poses: Starts, each maps the points into the map.
        num_steps: Fixed number of steps.
        start_distance: Robust scale at the start [voxel].
        final_distance: Robust scale at the end [voxel].
        batch_size: Poses handled together.

    Returns:
        Refined poses, same order.
    """
    total = jnp.maximum(jnp.sum(weights, dtype=jnp.float32), 1e-12)
    centre = jnp.sum(points * weights[:, None], axis=0, dtype=jnp.float32) / total
    centred = points - centre[None, :]
    num_shrinking = max(2 * num_steps // 3, 1)
    ratio = jnp.asarray(final_distance, jnp.float32) / jnp.asarray(start_distance, jnp.float32)

    def step(T: Array, i: Array) -> tuple[Array, None]:
        progress = jnp.minimum(i.astype(jnp.float32) / num_shrinking, 1.0)
        scale = voxel_size * jnp.asarray(start_distance, jnp.float32) * ratio**progress
        arm = centred @ T[:3, :3].T
        moved = arm + (T[:3, :3] @ centre + T[:3, 3])[None, :]
        key = lookup(keys, dims, origin, voxel_size, moved, NOTHING_NEAR)
        row = split_keys(key)[0] % surface.shape[0]
        gap = moved - surface[row]
        normal = normals[row]
        residual = jnp.sum(gap * normal, axis=1, dtype=jnp.float32)
        distance_sq = jnp.sum(gap * gap, axis=1, dtype=jnp.float32)
        robust = 1.0 / (1.0 + distance_sq / (scale * scale)) ** 2
        weight = jnp.where(key == NOTHING_NEAR, 0.0, weights * robust)
        jacobian = jnp.concatenate([normal, jnp.cross(arm, normal)], axis=1)
        hessian, gradient = point_to_plane_system(residual, jacobian, weight)
        damping = DAMPING * jnp.trace(hessian) / 6.0 + 1e-12
        delta = -jnp.linalg.solve(hessian + damping * jnp.eye(6, dtype=jnp.float32), gradient)
        delta = jnp.clip(delta, -0.5, 0.5)
        rotation = rigid.exp_so3(delta[3:]) @ T[:3, :3]
        target = T[:3, :3] @ centre + T[:3, 3] + delta[:3]
        return rigid.from_rotation_translation(rotation, target - rotation @ centre), None

    def refine(T: Array) -> Array:
        T = jax.lax.scan(step, T, jnp.arange(num_steps, dtype=jnp.int32))[0]
        u, _, vt = jnp.linalg.svd(T[:3, :3])
        return rigid.from_rotation_translation(u @ vt, T[:3, 3])

    return jax.lax.map(refine, poses, batch_size=batch_size)
