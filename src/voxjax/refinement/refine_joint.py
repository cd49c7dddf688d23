"""Refinement of the poses of N maps together, on the surfaces that pairs of them share."""

from collections.abc import Mapping, Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int32

from .._checks import InputError, check_choice, check_pose
from .._results import RESULTS
from .._types import Array
from ..grid import VoxelGrid
from ..maps.prepared import PreparedMap
from .maps.coarse_to_fine import (
    COARSE_POINTS,
    CoarseLevel,
    better,
    checked_distances,
    coarse_levels,
    scales_in_reach,
    turned,
)
from .maps.joint import joint_maps, joint_problem
from .maps.joint_pairs import (
    Pair,
    check_map,
    checked_pairs,
    checked_terms,
    connected_parts,
    held_maps,
    overlapping_pairs,
    with_named,
)
from .maps.many_starts import spread_solves
from .maps.pair import checked_residuals
from .maps.views import views_of
from .residuals.losses import Loss
from .residuals.terms import Term
from .solve.joint import solve_joint
from .solve.joint_covariance import joint_covariance
from .solve.pose import problem_cost


class JointRefinement(eqx.Module):
    """Outcome of `voxjax.refine_joint`.

    Attributes:
        poses: float32 (maps, 4, 4) `T_world_map`; together never worse than the start under the cost. Maps in `held`
            have the pose that they had.
        covariance: float32 (maps, 6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of each
            map expressed in the world, given the poses in `held`; for these it is 0, and that of a map without a pair
            means nothing. It has no derivative.
        result: `successful`, `not_converged`, `degenerate` (a map slides, see `covariance`), `no_overlap` or
            `empty_map` (there was no pair to refine).
        pairs: The pairs that were held against each other.
        held: Maps that kept their pose: the anchor, and the first map of each set that no pair connects with it.
        unpaired: Maps without a pair, all in `held`.
        num_steps: Steps of the solver, all levels together, without those on coarser maps.
        cost_before: Mean over the pairs of the robust cost of the start, in [0, 1] for bounded losses.
        cost_after: The same after refinement.
    """

    poses: Float[Array, "maps 4 4"]
    covariance: Float[Array, "maps 6 6"]
    result: RESULTS
    pairs: tuple[tuple[int, int], ...]
    held: tuple[int, ...]
    unpaired: tuple[int, ...]
    num_steps: Int32[Array, ""]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]


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
    more make a `refinement.maps.joint.joint_problem` and give it to `refinement.solve_joint`.

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
    check_choice("loss", loss, ("geman_mcclure", "cauchy", "huber", "squared"))
    if num_points < 1:
        raise InputError(f"num_points must be 1 or more, got {num_points}.")
    kinds = checked_residuals(residuals)
    if len(grids) < 2 or len(grids) != len(poses):
        raise InputError(
            f"grids and poses must be two or more and equally many, got {len(grids)} and {len(poses)}."
        )
    start = np.stack([_checked_start(number, T) for number, T in enumerate(poses)])
    check_map("anchor", anchor, len(grids))
    chosen = None if pairs is None else checked_pairs("pairs", pairs, len(grids))
    named = checked_terms(terms, chosen, len(grids))

    views = views_of({f"grids[{number}]": grid for number, grid in enumerate(grids)}, soft=soft)
    filled = {number: view.prepared for number, view in enumerate(views) if view is not None}
    voxel = max((prepared.grid.voxel_size for prepared in filled.values()), default=1.0)
    first, last = checked_distances(max_distance, final_distance, voxel)
    coarse = coarse_levels(list(filled.values()), first, voxel)
    if chosen is None:
        seen = dict(zip(filled, coarse[0].maps, strict=True)) if coarse else filled
        chosen = overlapping_pairs([seen.get(number) for number in range(len(grids))], start)
    chosen = [(a, b) for a, b in with_named(chosen, named) if a in filled and b in filled]

    parts = connected_parts(len(grids), chosen)
    is_held = held_maps(parts, anchor)
    held = tuple(np.flatnonzero(is_held).tolist())
    unpaired = tuple(np.flatnonzero(np.bincount(parts, minlength=len(grids))[parts] == 1).tolist())
    if not chosen:
        reason = RESULTS.empty_map if len(filled) < 2 else RESULTS.no_overlap
        return _nothing_to_refine(start, reason, held, unpaired)

    made = joint_maps(views, chosen, kinds, num_points)
    dtype = made.centroids.dtype
    problem = made.problem(chosen, is_held, residuals=kinds, terms=named, loss=loss)
    planes = problem
    if kinds.get("planes") != 1.0:
        planes = made.problem(chosen, is_held, residuals=checked_residuals(None), terms={}, loss=loss)
    scales = scales_in_reach(first, last, voxel).astype(dtype)
    # Beside the world's origin, float32 keeps its digits.
    shift = np.zeros((1, 4, 4), dtype)
    shift[0, :3, 3] = start[anchor, :3, 3]
    near = jnp.asarray(start.astype(dtype) - shift)
    led = _lead(near, made.centroids, tuple(filled), coarse, chosen, is_held, loss)
    found = solve_joint(problem, led, scales)
    if coarse:
        before = problem_cost(problem, near, scales)
        T, after = better(near, before, found.poses, found.cost_after)
        found = found._replace(poses=T, cost_before=before, cost_after=after)

    num_voxels = np.zeros(len(grids), dtype)
    num_voxels[list(filled)] = [prepared.num_points for prepared in filled.values()]
    known = jax.lax.stop_gradient((planes, found.poses))
    covariance = joint_covariance(*known, scales[-1], num_voxels, np.asarray(voxel, dtype))
    spread_out = jnp.linalg.eigvalsh(covariance[:, :3, :3])[:, -1]
    result = RESULTS.where(found.converged, RESULTS.successful, RESULTS.not_converged)
    return JointRefinement(
        poses=jnp.where(is_held[:, None, None], start.astype(dtype), found.poses + shift),
        covariance=covariance,
        result=RESULTS.where(jnp.any(spread_out > scales[-1] ** 2), RESULTS.degenerate, result),
        pairs=tuple(chosen),
        held=held,
        unpaired=unpaired,
        num_steps=found.num_steps,
        cost_before=found.cost_before / len(chosen),
        cost_after=found.cost_after / len(chosen),
    )


def _checked_start(number: int, T_world_map: object) -> np.ndarray:
    """A start as values: under `jax.grad` and `jax.jvp` those of what is traced."""
    if isinstance(T_world_map, jax.Array):
        T_world_map = jax.lax.stop_gradient(T_world_map)
        if isinstance(T_world_map, Tracer):
            raise InputError(
                f"poses[{number}] must be values, not traced by jit or vmap: they decide which maps overlap; compile "
                "`refinement.solve_joint` instead."
            )
    return check_pose(f"poses[{number}]", T_world_map)


def _lead(
    start: Float[Array, "maps 4 4"],
    centroids: Float[Array, "maps 3"],
    numbers: Sequence[int],
    coarse: Sequence[CoarseLevel],
    pairs: Sequence[Pair],
    is_held: Bool[np.ndarray, "maps"],
    loss: Loss,
) -> Float[Array, "maps 4 4"]:
    """Lead all poses together along coarser maps, to within the reach of the maps themselves.

    The starts go with turned ones, all maps alike that are not held, each about its own centroid; the poses of least
    cost on the finest of the coarser maps are taken.

    Args:
        start: `T_world_map` of all maps.
        centroids: Of the maps [m].
        numbers: Of the maps that the coarser ones are of.
        coarse: Coarser maps; without a level the starts stay.
        pairs: Which are held against each other.
        is_held: Which keep their pose.
        loss: What a large offset costs.
    """
    if not coarse:
        return start
    every_way = jnp.swapaxes(jax.vmap(turned)(start, centroids), 0, 1)
    ways = list(jnp.where(is_held[None, :, None, None], start[None], every_way))
    costs = [np.inf] * len(ways)
    for maps, scales in coarse:
        by_number = dict(zip(numbers, maps, strict=True))
        every = [by_number.get(number) for number in range(len(start))]
        problem = joint_problem(every, pairs, is_held, num_points=COARSE_POINTS, loss=loss)
        solve = partial(solve_joint, problem, scales=scales.astype(start.dtype))
        found = spread_solves(solve, ways)
        ways, costs = [each.poses for each in found], [float(each.cost_after) for each in found]
    return ways[int(np.argmin(costs))]


def _nothing_to_refine(
    start: np.ndarray, result: RESULTS, held: tuple[int, ...], unpaired: tuple[int, ...]
) -> JointRefinement:
    """The starts as they are."""
    one = np.asarray(1.0, np.float32)
    unknown = np.zeros((len(start), 6, 6), np.float32)
    return JointRefinement(start, unknown, result, (), held, unpaired, np.asarray(0, np.int32), one, one)
