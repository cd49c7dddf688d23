"""Point-to-plane alignment of many poses at once against the nearest-voxel field of a map."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, UInt32

from ... import rigid
from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._runtime.pieces import over_poses
from ..._runtime.placement import on_host
from ..._runtime.precision import in_full_precision
from ..._runtime.programs import kept_program
from ..._runtime.threads import num_cores
from ..._types import Array
from .lookup import Block, row_entries, turn_columns
from .nearest import nearest_rows


@refused_after_fork
def align_poses(
    keys: UInt32[Array, "flat"],
    block: Block,
    surface: Float32[Array, "m 3"],
    normals: Float32[Array, "m 3"],
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    *,
    num_steps: int = 20,
    start_distance: Float32[Array, ""] | np.floating | float = 5.0,
    final_distance: Float32[Array, ""] | np.floating | float = 1.5,
    batch_size: int = 4,
) -> Float32[Array, "k 4 4"]:
    """Refine poses of points onto a voxel surface by iterated re-weighted point-to-plane steps.

    The robust scale shrinks geometrically over the first two thirds of the steps, so that a coarse pose is pulled in
    and furniture seen by one map only lets go at the end.

    Args:
        keys: Nearest-voxel field of the map, flat over the block.
        block: Place and size of the map's block.
        surface: Occupied voxel centres the keys point to [m].
        normals: Unit normals of those voxels.
        points: Points of the other map [m].
        weights: Weight of each point; 0 for padding.
        poses: Starts, each of which maps the points into the map.
        num_steps: Fixed number of steps.
        start_distance: Robust scale at the start [voxel].
        final_distance: Robust scale at the end [voxel].
        batch_size: Poses handled together where all is one kernel: under a transformation, and not on a CPU.

    Returns:
        Refined poses, same order.
    """
    # As arrays, the distances are no part of the kept program, so that others need no other one.
    robust = jnp.asarray(start_distance, jnp.float32), jnp.asarray(final_distance, jnp.float32)
    target = _Target(keys, Block.of(*block), surface, normals)
    if not on_host(target, points, weights, poses, robust):
        return _align_at_once(target, points, weights, poses, *robust, num_steps, batch_size)
    # `over_poses` takes one pose at least.
    if len(poses) == 0:
        return jnp.zeros((0, 4, 4), jnp.float32)
    # The arrays are put there once, and all pieces take them as they are.
    held = jax.device_put((target, points, weights, *robust))
    aligned = over_poses(
        lambda some, count: _align_piece(*held, some, count, num_steps),
        np.asarray(poses),
        least_jobs=num_cores(),
    )
    return jax.device_put(aligned)


class _Target(NamedTuple):
    """The surface that points are brought onto."""

    keys: UInt32[Array, "flat"]
    block: Block
    surface: Float32[Array, "m 3"]
    normals: Float32[Array, "m 3"]


@partial(jax.jit, static_argnames=("num_steps", "batch_size"))
@in_full_precision
def _align_at_once(
    target: _Target,
    points: Array,
    weights: Array,
    poses: Array,
    start: Array,
    final: Array,
    num_steps: int,
    batch_size: int,
) -> Array:
    align = partial(_align, _Alignment.of(target, points, weights, start, final), num_steps=num_steps)
    return jax.lax.map(align, poses, batch_size=batch_size)


@kept_program
@partial(jax.jit, static_argnames="num_steps")
@in_full_precision
def _align_piece(
    target: _Target,
    points: Array,
    weights: Array,
    start: Array,
    final: Array,
    poses: Array,
    count: Array,
    num_steps: int,
) -> Array:
    """The first `count` poses aligned, the others as they are."""
    alignment = _Alignment.of(target, points, weights, start, final)

    # A loop with a traced end: any number of poses is one program, and steps are not batched, under which what is
    # looked up would not stay written down (`materialized`).
    def one(i: jax.Array, aligned: jax.Array) -> jax.Array:
        return aligned.at[i].set(_align(alignment, poses[i], num_steps=num_steps))

    return jax.lax.fori_loop(0, count, one, poses)


class _Alignment(NamedTuple):
    """What all steps of all poses share: the surface, and the points by columns, also about their centre."""

    target: _Target
    columns: Array
    weights: Array
    centre: Array
    centred: Array
    start_distance: Array
    final_distance: Array

    @classmethod
    def of(cls, target: _Target, points: Array, weights: Array, start: Array, final: Array) -> "_Alignment":
        # Padding has no weight, so that its places do not move the centre; a list of padding alone has one at 0.
        total = jnp.maximum(jnp.sum(weights, dtype=jnp.float32), 1e-12)
        centre = jnp.sum(points * weights[:, None], axis=0, dtype=jnp.float32) / total
        return cls(target, points.T, weights, centre, (points - centre[None, :]).T, start, final)

    def step(self, T: Array, progress: Array) -> Array:
        """One re-weighted Gauss-Newton step; `progress` from 0 to 1 shrinks the robust scale."""
        # Share of the mean diagonal added to the normal equations: directions that no surface fixes do not move.
        share = 1e-4
        target, centre, weights = self.target, self.centre, self.weights
        scale = (
            target.block.voxel_size
            * self.start_distance
            * (self.final_distance / self.start_distance) ** progress
        )
        is_valid = target.block.voxel_size > 0
        # Match: the nearest occupied voxel of each point and the normal there.
        is_near, row = nearest_rows(target.keys, lambda: target.block.cells_under(T, self.columns), is_valid)
        surface, normal = materialized(
            lambda: (row_entries(target.surface, row), row_entries(target.normals, row)), is_valid
        )
        # Turns act about the centre of the points: about the origin of the frame they would move far points too, and
        # float32 would lose the digits of the small angles.
        arm = turn_columns(T, self.centred)
        image = T[:3, :3] @ centre + T[:3, 3]
        gap = [arm[k] + (image[k] - surface[k]) for k in range(3)]
        residual = gap[0] * normal[0] + gap[1] * normal[1] + gap[2] * normal[2]
        distance_sq = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]
        # Weights fall with the distance to the matched voxel, not to its plane, which reaches beyond its surface.
        # The weights are those of Geman and McClure: the pull of a match dies out with its distance.
        robust = 1.0 / (1.0 + distance_sq / (scale * scale)) ** 2
        weight = jnp.where(is_near, weights * robust, 0.0)
        # Negative places count from the end, so this is arm x normal: how the residual changes under a small turn.
        turn = [arm[k - 2] * normal[k - 1] - arm[k - 1] * normal[k - 2] for k in range(3)]
        # The residual as a seventh row: one product gives normal matrix and gradient.
        jacobian = jnp.stack([*normal, *turn, residual])
        system = (jacobian * weight[None, :]) @ jacobian.T
        hessian, gradient = system[:6, :6], system[:6, 6]
        # Of shifts and of turns each a share of its own: their entries differ by squared metres. A pose that meets
        # nothing has a matrix of zeros; the constant keeps it solvable, and the pose stays where it is.
        shares = jnp.diagonal(hessian).reshape(2, 3).mean(axis=1)
        damping = jnp.repeat(share * shares + 1e-12, 3, total_repeat_length=6)
        delta = -jnp.linalg.solve(hessian + jnp.diag(damping), gradient)
        # A start that meets few points must not be thrown farther than matches are looked for, nor turned far [rad].
        farthest = target.block.voxel_size * self.start_distance
        bounds = jnp.concatenate([jnp.full(3, farthest, jnp.float32), jnp.full(3, 0.5, jnp.float32)])
        delta = jnp.clip(delta, -bounds, bounds)
        rotation = rigid.exp_so3(delta[3:]) @ T[:3, :3]
        # The centre goes where the step says, and the translation follows from it.
        moved = image + delta[:3]
        return rigid.from_rotation_translation(rotation, moved - rotation @ centre)


def _align(alignment: _Alignment, T: Array, *, num_steps: int) -> Array:
    num_shrinking = max(2 * num_steps // 3, 1)

    def step(T: Array, i: Array) -> tuple[Array, None]:
        return alignment.step(T, jnp.minimum(i.astype(jnp.float32) / num_shrinking, 1.0)), None

    T = jax.lax.scan(step, T, jnp.arange(num_steps, dtype=jnp.int32))[0]
    # Products of many small rotations drift away from the rotations by rounding.
    return rigid.from_rotation_translation(rigid.nearest_rotation(T[:3, :3]), T[:3, 3])
