"""Refinement of a pose on the surfaces of two maps, by optimistix (section IV.D)."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Float32, Int32

from .. import rigid
from .._checks import InputError, check_choice, check_pose, check_positive
from .._results import RESULTS
from .._types import Array
from ..grid import VoxelGrid
from .losses import Loss
from .prepared import PreparedMap, prepare_map, sample_rows
from .residuals import (
    MIN_PLANARITY,
    Backward,
    Sample,
    Surface,
    mean_cost,
    move_about,
    mutual_residuals,
    plane_information,
)

START_DISTANCE, FINAL_DISTANCE = 4.0, 1.0
"""Robust scale of the first and of the last level [voxel]."""

LEVELS_PER_OCTAVE = 2
"""Levels while the robust scale halves."""

MAX_STEPS = 24
"""Steps of Levenberg-Marquardt on each level."""

TOLERANCE = 1e-5
"""Relative and absolute; float32 gains nothing below (measured)."""

PATCH_VOXELS = 1000.0
"""Surface voxels that share one error: maps are wrong by whole patches, not voxel by voxel. With so many the normalised
errors squared of accepted generated pairs have the mean that they should have (`python -m bench calibration`); maps
that drift by more than a voxel need more."""

MAP_ACCURACY = 0.1
"""Error that no number of patches takes away [voxel], and about the same at the map's radius."""

PRIOR = 1.0
"""A direction that no surface fixes is uncertain by this [m, or m at the map's radius]."""


class Refinement(eqx.Module):
    """Outcome of `voxjax.refine`.

    Attributes:
        T_a_b: float32 (4, 4): maps points of b into a. Never worse than the start under the cost.
        covariance: float32 (6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of map
            b expressed in frame a.
        result: `successful`, `not_converged`, `degenerate` or `empty_map`.
        num_steps: Steps of the solver, all levels together.
        cost_before: Robust cost of the start, in [0, 1] for bounded losses.
        cost_after: The same after refinement.
    """

    T_a_b: Float32[Array, "4 4"]
    covariance: Float32[Array, "6 6"]
    result: RESULTS
    num_steps: int
    cost_before: float
    cost_after: float


class RefinedPose(NamedTuple):
    """Arrays that `refine_pose` gives: pose, costs, steps, whether the last level converged."""

    T_a_b: Float[Array, "4 4"]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]
    num_steps: Int32[Array, ""]
    converged: Bool[Array, ""]


def refine(
    a: VoxelGrid | PreparedMap,
    b: VoxelGrid | PreparedMap,
    T_a_b: object,
    *,
    max_distance: float | None = None,
    final_distance: float | None = None,
    num_points: int = 8192,
    loss: Loss = "geman_mcclure",
    both_ways: bool = False,
) -> Refinement:
    """Refine a pose so that the occupied voxels of b lie on the surfaces of a.

    Robust point-to-plane Levenberg-Marquardt, coarse to fine: the robust scale shrinks from `max_distance` to
    `final_distance`, so that a pose several voxels off is pulled in and what only one map saw lets go.

    Args:
        a: The map whose frame the pose maps into; its field of nearest voxels reaches 5 voxels.
        b: The map that is moved.
        T_a_b: Start, (4, 4).
        max_distance: Robust scale at the start [m]; None takes 4 voxels of a.
        final_distance: Robust scale at the end [m]; None takes 1 voxel of a.
        num_points: Voxels of b to use, chosen by what they rule out.
        loss: "geman_mcclure" (bounded), "cauchy", "huber" or "squared".
        both_ways: Bring also the voxels of a onto the surfaces of b, each way with half of the weight: the errors of
            both maps' planes average out, and the maps the other way round give the inverse pose.

    Returns:
        The refined pose with its covariance; the start itself where no better one was found.

    Raises:
        InputError: If the start is no rigid transform or a length is not positive.

    References:
        Section IV.D and V.B: the exact transform comes from the matches and their neighbouring points.
    """
    check_choice("loss", loss, ("geman_mcclure", "cauchy", "huber", "squared"))
    if num_points < 1:
        raise InputError(f"num_points must be 1 or more, got {num_points}.")
    start = check_pose("T_a_b", T_a_b)
    target, other = (m if isinstance(m, PreparedMap) else _prepared(m) for m in (a, b))
    if target is None or other is None:
        return _nothing_to_refine(start)
    voxel = target.grid.voxel_size
    first = (
        START_DISTANCE * voxel if max_distance is None else check_positive("max_distance", max_distance, "m")
    )
    last = FINAL_DISTANCE * voxel if final_distance is None else final_distance
    last = min(check_positive("final_distance", last, "m"), first)
    is_signed = target.has_free_space and other.has_free_space
    surface, sample = surface_of(target, is_signed=is_signed), sample_of(other, num_points)
    back = None
    if both_ways:
        back = Backward(surface_of(other, is_signed=is_signed), sample_of(target, num_points))
    num_levels = max(int(np.ceil(LEVELS_PER_OCTAVE * np.log2(first / last) - 1e-6)), 1)
    scales = np.geomspace(last, first, num_levels)[::-1].astype(np.float32)
    radius = _radius(sample)
    found = refine_pose(jnp.asarray(start), surface, sample, scales, radius, back, loss=loss)
    covariance, is_degenerate = pose_covariance(
        found.T_a_b, surface, sample, scales[-1], radius, np.float32(other.num_points / PATCH_VOXELS), back
    )
    if bool(is_degenerate):
        result = RESULTS.degenerate
    else:
        result = RESULTS.successful if bool(found.converged) else RESULTS.not_converged
    return Refinement(
        T_a_b=found.T_a_b,
        covariance=covariance,
        result=result,
        num_steps=int(found.num_steps),
        cost_before=float(found.cost_before),
        cost_after=float(found.cost_after),
    )


def surface_of(prepared: PreparedMap, *, is_signed: bool) -> Surface:
    """What the residuals need of map a; `is_signed` if free space tells sides apart in both maps."""
    rows = prepared.anchors, prepared.normals, prepared.planarity
    return Surface(prepared.keys, *prepared.block, *rows, jnp.asarray(is_signed))


def sample_of(prepared: PreparedMap, num_points: int) -> Sample:
    """`num_points` voxels of map b, drawn by leverage; voxels repeat where the map has fewer."""
    rows = sample_rows(prepared, num_points)
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    is_planar = np.asarray(prepared.planarity)[rows] > MIN_PLANARITY
    normals = np.where(is_planar[:, None], np.asarray(prepared.normals)[rows], np.float32(0.0))
    return Sample(np.asarray(prepared.anchors)[rows], normals, weights, np.asarray(prepared.centroid))


@partial(jax.jit, static_argnames=("loss",))
def refine_pose(
    T_a_b: Float[Array, "4 4"],
    surface: Surface,
    sample: Sample,
    scales: Float[Array, "levels"],
    radius: Float[Array, ""],
    back: Backward | None = None,
    *,
    loss: Loss = "geman_mcclure",
) -> RefinedPose:
    """Levenberg-Marquardt on one level after the other; differentiable by the implicit function theorem.

    Args:
        T_a_b: Start.
        surface: Of map a.
        sample: Of map b.
        scales: Robust scale of each level [m].
        radius: Length that turns radians into metres [m].
        back: The other way round; None for one way only.
        loss: What a large offset costs.
    """
    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE, linear_solver=lx.Normal(lx.Cholesky()))

    def level(T: Array, scale: Array) -> tuple[Array, tuple[Array, Array]]:
        # Unknowns of order one: translation in scales, rotation in scales at the map's radius.
        units = jnp.concatenate([jnp.full(3, 1.0, T.dtype), jnp.full(3, 1.0, T.dtype) / radius]) * scale

        def residuals(unknowns: Array, args: tuple) -> Array:
            T, surface, sample, back, scale, units = args
            moved = move_about(T, sample.centroid, unknowns * units)
            return mutual_residuals(moved, surface, sample, back, scale, loss=loss)

        args = (T, surface, sample, back, scale, units)
        solution = optx.least_squares(
            residuals,
            solver,
            jnp.zeros(6, T.dtype),
            args,
            options={"jac": "fwd"},
            max_steps=MAX_STEPS,
            throw=False,
        )
        moved = move_about(T, sample.centroid, solution.value * units)
        before = mean_cost(T, surface, sample, scale, loss=loss, back=back)
        is_better = mean_cost(moved, surface, sample, scale, loss=loss, back=back) < before
        steps = jnp.asarray(solution.stats["num_steps"], jnp.int32)
        return jnp.where(is_better, moved, T), (steps, solution.result == optx.RESULTS.successful)

    T, (steps, converged) = jax.lax.scan(level, T_a_b, scales)
    T = _orthonormal(T)
    before = mean_cost(T_a_b, surface, sample, scales[-1], loss=loss, back=back)
    after = mean_cost(T, surface, sample, scales[-1], loss=loss, back=back)
    is_better = after < before
    return RefinedPose(
        jnp.where(is_better, T, T_a_b),
        before,
        jnp.where(is_better, after, before),
        jnp.sum(steps, dtype=jnp.int32),
        converged[-1],
    )


def _orthonormal(T: Float[Array, "4 4"]) -> Float[Array, "4 4"]:
    """Undo the rounding of many small motions by one Newton step toward the nearest rotation."""
    rotation = T[:3, :3]
    eye = jnp.eye(3, dtype=T.dtype)
    return rigid.from_rotation_translation(rotation @ (1.5 * eye - 0.5 * rotation.T @ rotation), T[:3, 3])


@jax.jit
def pose_covariance(
    T_a_b: Float[Array, "4 4"],
    surface: Surface,
    sample: Sample,
    scale: Float[Array, ""],
    radius: Float[Array, ""],
    num_patches: Float[Array, ""],
    back: Backward | None = None,
) -> tuple[Float[Array, "6 6"], Bool[Array, ""]]:
    """Covariance of the tangent about the centroid of b in frame a, and whether a direction is not fixed.

    Args:
        T_a_b: Refined pose.
        surface: Of map a.
        sample: Of map b.
        scale: Robust scale [m].
        radius: Length that turns radians into metres [m].
        num_patches: Independent observations if all of b met a plane.
        back: The other way round; None for one way only.
    """
    information, variance, _ = plane_information(T_a_b, surface, sample, scale, back)
    # Voxels round positions: a twelfth of a voxel squared, even where all offsets happen to vanish.
    variance = variance + surface.voxel_size**2 / 12.0
    units = jnp.concatenate([jnp.ones(3, T_a_b.dtype), jnp.ones(3, T_a_b.dtype) / radius])
    scaled = information * units[:, None] * units[None, :] * num_patches / variance
    values, vectors = jnp.linalg.eigh(scaled)
    spread = (vectors / (jnp.maximum(values, 0.0) + 1.0 / PRIOR**2)[None, :]) @ vectors.T
    spread = spread + (MAP_ACCURACY * surface.voxel_size) ** 2 * jnp.eye(6, dtype=T_a_b.dtype)
    is_degenerate = values[0] < 1.0 / scale**2
    return spread * units[:, None] * units[None, :], is_degenerate


def _radius(sample: Sample) -> np.float32:
    """Root mean square distance of the sample from the centroid [m]."""
    offset = np.asarray(sample.points) - np.asarray(sample.centroid)[None, :]
    return np.float32(max(np.sqrt((offset**2).sum(axis=1).mean()), 1e-3))


def _prepared(grid: VoxelGrid) -> PreparedMap | None:
    """The map prepared, or None if nothing is occupied."""
    return prepare_map(grid) if grid.num_occupied else None


def _nothing_to_refine(start: np.ndarray) -> Refinement:
    """The start, with a covariance that says that nothing is known."""
    return Refinement(
        start, np.eye(6, dtype=np.float32) * np.float32(PRIOR**2), RESULTS.empty_map, 0, 1.0, 1.0
    )
