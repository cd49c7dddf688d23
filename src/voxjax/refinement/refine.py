"""Refinement of a pose on the surfaces of two maps, by optimistix (section IV.D)."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.errors import TracerArrayConversionError

from .._checks import InputError
from .._runtime.forks import refused_after_fork
from .._runtime.placement import is_traced
from .._types import Array
from ..frames import to_local
from ..grid import VoxelGrid
from ..maps.prepared import PreparedMap
from .outcome import Refinement, has_ended, how_it_ended, unrefined_pose
from .problems.coarse_to_fine import better, checked_distances, coarse_levels, scales_in_reach
from .problems.local_frames import local_frames
from .problems.many_starts import solve_starts, spread_solves
from .problems.pair import check_options, checked_residuals, pose_problem
from .problems.starts import checked_start, lead_pose
from .problems.views import views_of
from .residuals.losses import Loss
from .residuals.terms import Term, check_terms
from .solve.covariance import PATCH_VOXELS, pose_covariance
from .solve.pose import RefinedPose, problem_cost, solve_pose
from .solve.problem import PoseProblem


@refused_after_fork
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
    residuals: Mapping[str, float] | None = None,
    terms: Sequence[Term] = (),
    soft: bool = False,
) -> Refinement:
    """Refine a pose so that the occupied voxels of b lie on the surfaces of a.

    Robust point-to-plane Levenberg-Marquardt, coarse to fine: the robust scale shrinks from `max_distance` to
    `final_distance` (graduated non-convexity), so that a pose several voxels off is pulled in and what only one map saw
    lets go. Starts farther off than the field of nearest voxels reaches are first refined on coarser maps.

    The result is differentiable (`jax.grad`, `jax.jvp`) by the implicit function theorem: with `soft`, in the log-odds
    of both maps; in whatever floats in `terms`; and in the start where a term holds it (`refinement.Prior`),
    because otherwise the solution does not depend on its start. Which voxels are used, and which is nearest, is decided
    by the states, and is constant. For more (weights of points, parameters of residuals, pairs under vmap) make a
    `refinement.problems.pair.pose_problem` and give it to `refinement.solve.pose.solve_pose`.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        T_a_b: Start, (4, 4); or (k, 4, 4), k starts: those that meet on the way are carried on once.
        max_distance: Robust scale at the start [m]; None takes 4 voxels of a.
        final_distance: Robust scale at the end [m]; None takes 1 voxel of a.
        num_points: Voxels of b to use, chosen by what they rule out.
        loss: "geman_mcclure" (bounded), "cauchy", "huber" or "squared".
        both_ways: Bring also the voxels of a onto the surfaces of b, each way with half of the weight: the errors of
            both maps' planes average out, and the maps the other way round give the inverse pose.
        residuals: Kinds of residuals and their weights: "planes" (point to plane), "distances" (truncated distance
            field, signed where free space tells sides apart), "occupancies" (soft agreement, conflicts with free space
            four times as dear as the unknown). None: planes alone.
        terms: Further residuals, as `refinement.CornerPairs`.
        soft: Weigh voxels by their probabilities. Both maps must be grids with log-odds.

    Returns:
        The refined pose with its covariance; the start itself where no better one was found.

    Raises:
        InputError: If the start is no rigid transform, a length is not positive, a kind is not known, log-odds are
            traced without `soft` (the result would not depend on them), or a map lies too far from the origin of its
            frame for float32 where the start or log-odds are traced or there are `terms`.

    References:
        Section IV.D and V.B: the exact transform comes from the matches and their neighbouring points.
    """
    check_options(loss, num_points)
    kinds = checked_residuals(residuals)
    terms = check_terms("terms", terms)
    given = checked_start("T_a_b", T_a_b)
    frames = local_frames({"a": a, "b": b}, is_wanted=not terms and not is_traced(given))
    target, other = views_of(frames.grids, soft=soft)
    if target is None or other is None:
        return unrefined_pose(given)
    start = given if is_traced(given) else to_local(np.asarray(given), *frames.origins).astype(np.float32)

    # Starts beyond the reach of the maps' own fields are led to within it, along coarser maps.
    voxel = target.prepared.grid.voxel_size
    first, last = checked_distances(max_distance, final_distance, voxel)
    coarse = coarse_levels([target.prepared, other.prepared], first, voxel)
    led = lead_pose(start, other.prepared.centroid, coarse, loss=loss, both_ways=both_ways)

    # On the maps themselves the robust scale falls, level by level.
    # The problem of the covariance, where it is another one, is of the same maps, points and ways as the one
    # that is solved.
    between = partial(pose_problem, target, other, num_points=num_points, both_ways=both_ways)
    try:
        problem = between(residuals=kinds, loss=loss)
    except TracerArrayConversionError as error:
        raise InputError(
            "refine chooses voxels on the host, which jax.jit cannot trace; make a "
            "voxjax.refinement.problems.pair.pose_problem before, and give it to solve_pose under jit."
        ) from error
    # The covariance counts planes of weight 1, whatever is minimised: it must not depend on weights.
    planes = problem if kinds.get("planes") == 1.0 else between()
    # The caller's terms come on top of the maps' own, and only into what is minimised: the covariance does not
    # know them.
    problem = PoseProblem((*problem.terms, *terms), problem.centroid, problem.radius)
    scales = scales_in_reach(first, last, voxel).astype(problem.centroid.dtype)
    found = (solve_starts if start.ndim == 3 else solve_pose)(problem, led, scales)
    if coarse:
        found = _beside_start(found, problem, start, scales)

    # Maps err by patches of surface, of which a small map has fewer.
    num_patches = np.asarray(other.prepared.num_points / PATCH_VOXELS, scales.dtype)
    covariance = partial(pose_covariance, planes, scale=scales[-1], num_patches=num_patches)
    covariances, is_degenerate = _each(covariance, found.T_a_b)
    outcome = jax.vmap(how_it_ended) if start.ndim == 3 else how_it_ended
    return Refinement(
        T_a_b=frames.own_pose(found.T_a_b, start, given),
        covariance=covariances,
        result=outcome(has_ended(found.converged, found.cost_after), jnp.asarray(is_degenerate)),
        num_steps=found.num_steps,
        cost_before=found.cost_before,
        cost_after=found.cost_after,
    )


def _beside_start(found: RefinedPose, problem: PoseProblem, start: Array, scales: Array) -> RefinedPose:
    """What was found from where a start was led, or the start where that was better.

    The solver compares what it finds with the pose that it is given, which is not the user's once that was led.
    """
    (before,) = _each(lambda T: (problem_cost(problem, T, scales),), start)
    T, after = better(start, before, found.T_a_b, found.cost_after)
    return found._replace(T_a_b=T, cost_before=before, cost_after=after)


def _each(function: Callable[[Array], tuple[Array, ...]], poses: Array) -> tuple[Array, ...]:
    """A function of a pose, of one or of each of several."""
    # Starts are computed on all cores instead of under `vmap`, as in `solve_starts`.
    if poses.ndim == 2:
        return function(poses)
    return tuple(np.stack(column) for column in zip(*spread_solves(function, list(poses)), strict=True))
