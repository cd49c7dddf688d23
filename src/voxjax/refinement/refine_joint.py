"""Refinement of the poses of N maps together, on the surfaces that pairs of them share."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .._checks import InputError, check_list
from .._results import RESULTS
from .._runtime.forks import refused_after_fork
from .._types import Array
from ..frames import image
from ..grid import VoxelGrid
from ..maps.prepared import PreparedMap
from .outcome import JointRefinement, has_ended, how_it_ended, unrefined_poses
from .problems.coarse_to_fine import CoarseLevel, better, checked_distances, coarse_levels, scales_in_reach
from .problems.joint import joint_maps
from .problems.joint_pairs import (
    Pair,
    check_map,
    checked_pairs,
    checked_terms,
    connected_parts,
    held_maps,
    overlapping_pairs,
    with_named,
)
from .problems.local_frames import local_frames
from .problems.pair import check_options, checked_residuals
from .problems.starts import checked_starts, lead_poses, values_of_start
from .problems.views import views_of
from .residuals.losses import Loss
from .residuals.terms import Term
from .solve.joint import solve_joint
from .solve.joint_covariance import joint_covariance
from .solve.joint_problem import JointProblem
from .solve.pose import problem_cost


@refused_after_fork
def refine_joint(
    grids: Sequence[VoxelGrid | PreparedMap],
    poses: Sequence[object] | Array,
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    anchor: int = 0,
    max_distance: float | None = None,
    final_distance: float | None = None,
    num_points: int = 2048,
    loss: Loss = "geman_mcclure",
    residuals: Mapping[str, float] | None = None,
    terms: Mapping[tuple[int, int], Sequence[Term]] | None = None,
    soft: bool = False,
) -> JointRefinement:
    """Refine the poses of maps so that they agree with each other wherever they overlap.

    The cost is the sum over the pairs of that of `voxjax.refine` with `both_ways`, which all poses minimise together:
    errors are spread over loops instead of piling up along chains. Starts farther off than the fields of nearest voxels
    reach are first refined together on coarser maps.

    The poses are differentiable (`jax.grad`, `jax.jvp`) by the implicit function theorem: with `soft`, in the log-odds
    of all maps, and in whatever floats in `terms`. Starts count as constants: the solution does not depend on them.
    Which pairs there are, which voxels are used, and which is nearest, is decided by the states and the starts. For
    more make a `refinement.problems.joint.joint_problem` and give it to `refinement.solve_joint`.

    Args:
        grids: The maps, at least two.
        poses: Starts: one `T_world_map` (4, 4) a map, in a list or an array.
        pairs: Numbers (a, b) of the maps to hold against each other; None takes all that overlap under the starts: a
            tenth of the voxels of one, by leverage, are within 5 voxels of an occupied voxel of the other, both at the
            voxel size that the starts are first refined at. Pairs with a map that has no occupied voxel are left out.
        anchor: Number of the map whose pose stays.
        max_distance: Robust scale at the start [m]; None takes 4 voxels of the coarsest map.
        final_distance: Robust scale at the end [m]; None takes 1 voxel of the coarsest map.
        num_points: Voxels of each map to use in each of its pairs, chosen by what they rule out; of 16 maps of which
            all overlap, four times as many gave the same poses to a millimetre.
        loss: "geman_mcclure" (bounded), "cauchy", "huber" or "squared".
        residuals: Kinds of residuals of every pair and their weights, as of `voxjax.refine`; None: planes alone.
        terms: Further residuals of single pairs (a, b), about `T_a_b`, as `refinement.CornerPairs`. A pair that
            is named here is one of the pairs whether its maps overlap or not. Where `pairs` has (b, a) it is an error;
            where `pairs` is None the pair is held the way round that it is named.
        soft: Weigh voxels by their probabilities. All maps must be grids with log-odds.

    Returns:
        The refined poses; the starts where no better ones were found. Maps that no pair connects with the anchor are
        refined among themselves.

    Raises:
        InputError: If numbers of maps and poses differ, a start is no rigid transform, a map does not exist, a length
            is not positive, a kind is not known, `terms` names a pair the other way round than `pairs`, log-odds are
            missing or traced without `soft`, or the maps are too large for one table.

    References:
        Pulli, Multiview Registration for Large Data Sets, 1999.
    """
    check_options(loss, num_points)
    kinds = checked_residuals(residuals)
    grids, start = _checked_maps(grids, poses)
    check_map("anchor", anchor, len(grids))
    chosen = None if pairs is None else checked_pairs("pairs", pairs, len(grids))
    named = checked_terms(terms, chosen, len(grids))

    frames = local_frames(_named(grids), is_wanted=not terms)
    views = views_of(frames.grids, soft=soft)
    # One voxel size, that of the coarsest map, sets the lengths of all pairs.
    filled = {number: view.prepared for number, view in enumerate(views) if view is not None}
    voxel = max((prepared.grid.voxel_size for prepared in filled.values()), default=1.0)
    first, last = checked_distances(max_distance, final_distance, voxel)
    coarse = coarse_levels(list(filled.values()), first, voxel)
    # Poses are solved beside the world's origin, where float32 keeps its digits: it goes to where the anchor lies.
    world = image(start[anchor], frames.origins[anchor])
    local = frames.local_poses(start, world)
    if chosen is None:
        chosen = _overlapping(filled, coarse, local)
    chosen = [(a, b) for a, b in with_named(chosen, named) if a in filled and b in filled]

    # Residuals see relative poses alone, so one map of each set that pairs connect has to stay.
    parts = connected_parts(len(grids), chosen)
    is_held = held_maps(parts, anchor)
    held = tuple(np.flatnonzero(is_held).tolist())
    unpaired = tuple(np.flatnonzero(np.bincount(parts, minlength=len(grids))[parts] == 1).tolist())
    if not chosen:
        reason = RESULTS.empty_map if len(filled) < 2 else RESULTS.no_overlap
        return unrefined_poses(start, reason, held, unpaired)

    # The residuals of all pairs; covariances count planes of weight 1, whatever is minimised, as of `refine`.
    made = joint_maps(views, chosen, kinds, num_points)
    dtype = made.centroids.dtype
    problem = made.problem(chosen, is_held, residuals=kinds, terms=named, loss=loss)
    planes = problem
    if kinds.get("planes") != 1.0:
        planes = made.problem(chosen, is_held, residuals=checked_residuals(None), terms={}, loss=loss)
    scales = scales_in_reach(first, last, voxel).astype(dtype)

    near = jnp.asarray(local.astype(dtype))
    # Coarser maps lead far starts to within the reach of the maps' own fields, where all poses are solved together.
    led = lead_poses(near, made.centroids, coarse, tuple(filled), chosen, is_held, loss)
    found = solve_joint(problem, led, scales)
    if coarse:  # the solver has compared with where the starts were led, which the user did not give
        before = problem_cost(problem, near, scales)
        T, after = better(near, before, found.poses, found.cost_after)
        found = found._replace(poses=T, cost_before=before, cost_after=after)

    # Covariances come from what planes fix, given the maps that are held.
    num_voxels = np.asarray([view.prepared.num_points if view is not None else 0 for view in views], dtype)
    covariance, slides = _spread(planes, found.poses, scales, num_voxels, np.asarray(voxel, dtype))
    return JointRefinement(
        poses=frames.own_poses(found.poses, world, start, is_held),
        covariance=covariance,
        result=how_it_ended(has_ended(found.converged, found.cost_after), slides),
        pairs=tuple(chosen),
        held=held,
        unpaired=unpaired,
        num_steps=found.num_steps,
        cost_before=found.cost_before / len(chosen),
        cost_after=found.cost_after / len(chosen),
    )


def _named(grids: Sequence[VoxelGrid | PreparedMap]) -> dict[str, VoxelGrid | PreparedMap]:
    """The maps by the names that errors call them."""
    return {f"grids[{number}]": grid for number, grid in enumerate(grids)}


def _checked_maps(
    grids: Sequence[VoxelGrid | PreparedMap], poses: Sequence[object] | Array
) -> tuple[list[VoxelGrid | PreparedMap], Float[np.ndarray, "maps 4 4"]]:
    """The maps, which `views_of` looks at one by one, and their starts as values.

    Raises:
        InputError: If either is no list, there are too few, not as many starts as maps, or one is no rigid transform.
    """
    grids, poses = check_list("grids", grids, "maps"), check_list("poses", poses, "(4, 4) poses")
    if len(grids) < 2 or len(grids) != len(poses):
        raise InputError(
            f"grids and poses must be two or more and equally many, got {len(grids)} and {len(poses)}."
        )
    return grids, checked_starts("poses", [values_of_start(f"poses[{k}]", T) for k, T in enumerate(poses)])


def _overlapping(
    filled: Mapping[int, PreparedMap], coarse: Sequence[CoarseLevel], start: Float[np.ndarray, "maps 4 4"]
) -> list[Pair]:
    """Pairs of maps that overlap under the starts, at the voxel size that the starts are first refined at."""
    seen = dict(zip(filled, coarse[0].maps, strict=True)) if coarse else filled
    return overlapping_pairs([seen.get(number) for number in range(len(start))], start)


def _spread(
    planes: JointProblem,
    poses: Float[Array, "maps 4 4"],
    scales: Float[np.ndarray, "levels"],
    num_voxels: Float[Array, "maps"],
    voxel_size: Float[Array, ""],
) -> tuple[Float[Array, "maps 6 6"], Bool[Array, ""]]:
    """Covariances of the poses, and whether a map can slide: its place is less sure than the last robust scale.

    Both count points against planes alone, whatever the residuals were: only these know how much a wall is worth.
    """
    known = jax.lax.stop_gradient((planes, poses))
    covariance = joint_covariance(*known, scales[-1], num_voxels, voxel_size)
    longest = jnp.linalg.eigvalsh(covariance[:, :3, :3])[:, -1]
    return covariance, jnp.any(longest > scales[-1] ** 2)
