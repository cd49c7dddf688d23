"""Refinement of the poses of N maps together, on the surfaces that pairs of them share."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32

from .._checks import InputError, check_choice, check_pose, check_positive
from .._results import RESULTS
from .._threads import spread
from .._types import Array
from ..grid import VoxelGrid
from ..refinement.joint import solve_joint
from ..refinement.joint_covariance import joint_covariance
from ..refinement.losses import Loss
from .joint_maps import connected_parts, joint_problem, overlapping_pairs
from .prepared import PreparedMap, prepare_map
from .refine import FINAL_DISTANCE, START_DISTANCE, robust_scales


class JointRefinement(eqx.Module):
    """Outcome of `voxjax.refine_joint`.

    Attributes:
        poses: float32 (maps, 4, 4) `T_world_map`; together never worse than the start under the cost. Maps in `held`
            have the pose that they had.
        covariance: float32 (maps, 6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of each
            map expressed in the world, given the poses in `held`; for these it is 0, and that of a map without a pair
            means nothing.
        result: `successful`, `not_converged`, `degenerate` (a map slides, see `covariance`), `no_overlap` or
            `empty_map` (there was no pair to refine).
        pairs: The pairs that were held against each other.
        held: Maps that kept their pose: the anchor, and the first map of each set that no pair connects with it.
        unpaired: Maps without a pair, all in `held`.
        num_steps: Steps of the solver, all levels together.
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
    poses: Sequence[object],
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    anchor: int = 0,
    max_distance: float | None = None,
    final_distance: float | None = None,
    num_points: int = 2048,
    loss: Loss = "geman_mcclure",
) -> JointRefinement:
    """Refine the poses of maps so that they agree with each other wherever they overlap.

    The cost is the sum over the pairs of that of `voxjax.refine` with `both_ways`, which all poses minimise together:
    errors are spread over loops instead of piling up along chains.

    Args:
        grids: The maps, at least two.
        poses: Starts: one `T_world_map` (4, 4) a map.
        pairs: Numbers (a, b) of the maps to hold against each other; None takes all that overlap under the starts: a
            tenth of the voxels of one, by leverage, are within 5 voxels of an occupied voxel of the other. Pairs with a
            map that has no occupied voxel are left out.
        anchor: Number of the map whose pose stays.
        max_distance: Robust scale at the start [m]; None takes 4 voxels of the coarsest map.
        final_distance: Robust scale at the end [m]; None takes 1 voxel of the coarsest map.
        num_points: Voxels of each map to use in each of its pairs, chosen by what they rule out; of 16 maps of which
            all overlap, four times as many gave the same poses to a millimetre.
        loss: "geman_mcclure" (bounded), "cauchy", "huber" or "squared".

    Returns:
        The refined poses; the starts where no better ones were found. Maps that no pair connects with the anchor are
        refined among themselves.

    Raises:
        InputError: If numbers of maps and poses differ, a start is no rigid transform, a map does not exist, a length
            is not positive, or the maps are too large for one table.

    References:
        Pulli, Multiview Registration for Large Data Sets, 1999.
    """
    check_choice("loss", loss, ("geman_mcclure", "cauchy", "huber", "squared"))
    if num_points < 1:
        raise InputError(f"num_points must be 1 or more, got {num_points}.")
    if len(grids) < 2 or len(grids) != len(poses):
        raise InputError(
            f"grids and poses must be two or more and equally many, got {len(grids)} and {len(poses)}."
        )
    start = np.stack([check_pose(f"poses[{number}]", T) for number, T in enumerate(poses)])
    _check_map("anchor", anchor, len(grids))
    chosen = None if pairs is None else _checked_pairs(pairs, len(grids))

    maps = spread(_prepared, grids)
    filled = [prepared for prepared in maps if prepared is not None]
    if chosen is None:
        chosen = overlapping_pairs(maps, start)
    chosen = [(a, b) for a, b in chosen if maps[a] is not None and maps[b] is not None]
    voxel = max((prepared.grid.voxel_size for prepared in filled), default=1.0)
    first = (
        START_DISTANCE * voxel if max_distance is None else check_positive("max_distance", max_distance, "m")
    )
    last = FINAL_DISTANCE * voxel if final_distance is None else final_distance
    last = min(check_positive("final_distance", last, "m"), first)

    parts = connected_parts(len(grids), chosen)
    # One of each part stays where it is: the first, but of the anchor's part the anchor.
    is_held = parts == np.arange(len(grids))
    is_held[parts == parts[anchor]] = False
    is_held[anchor] = True
    held = tuple(np.flatnonzero(is_held).tolist())
    unpaired = tuple(np.flatnonzero(np.bincount(parts, minlength=len(grids))[parts] == 1).tolist())
    if not chosen:
        reason = RESULTS.empty_map if len(filled) < 2 else RESULTS.no_overlap
        return _nothing_to_refine(start, reason, held, unpaired)

    problem = joint_problem(maps, chosen, is_held, num_points=num_points, loss=loss)
    scales = robust_scales(first, last)
    # Beside the world's origin, float32 keeps its digits.
    shift = np.zeros((4, 4), np.float32)
    shift[:3, 3] = start[anchor, :3, 3]
    found = solve_joint(problem, jnp.asarray(start - shift), scales)
    num_voxels = np.asarray([0 if prepared is None else prepared.num_points for prepared in maps], np.float32)
    covariance = joint_covariance(problem, found.poses, scales[-1], num_voxels, np.float32(voxel))
    spread_out = np.linalg.eigvalsh(np.asarray(covariance)[:, :3, :3])[:, -1]
    result = RESULTS.where(found.converged, RESULTS.successful, RESULTS.not_converged)
    is_degenerate = jnp.asarray(bool((spread_out > scales[-1] ** 2).any()))
    refined = np.where(is_held[:, None, None], start, np.asarray(found.poses) + shift)
    return JointRefinement(
        poses=refined,
        covariance=covariance,
        result=RESULTS.where(is_degenerate, RESULTS.degenerate, result),
        pairs=tuple(chosen),
        held=held,
        unpaired=unpaired,
        num_steps=found.num_steps,
        cost_before=found.cost_before / len(chosen),
        cost_after=found.cost_after / len(chosen),
    )


def _prepared(given: VoxelGrid | PreparedMap) -> PreparedMap | None:
    """The map prepared, or None if nothing is occupied."""
    if isinstance(given, PreparedMap):
        return given
    return prepare_map(given) if given.num_occupied else None


def _check_map(name: str, number: int, num_maps: int) -> int:
    if number != int(number) or not 0 <= number < num_maps:
        raise InputError(f"{name} must be the number of a map, 0 to {num_maps - 1}, got {number!r}.")
    return int(number)


def _checked_pairs(pairs: Sequence[tuple[int, int]], num_maps: int) -> list[tuple[int, int]]:
    """Pairs of different maps, each once, in the order given."""
    checked = []
    for pair in pairs:
        if len(pair) != 2 or pair[0] == pair[1]:
            raise InputError(f"pairs must be two different maps each, got {tuple(pair)!r}.")
        checked.append((_check_map("pairs", pair[0], num_maps), _check_map("pairs", pair[1], num_maps)))
    if len({frozenset(pair) for pair in checked}) < len(checked):
        raise InputError(f"pairs must name each pair of maps once, got {checked!r}.")
    return checked


def _nothing_to_refine(
    start: np.ndarray, result: RESULTS, held: tuple[int, ...], unpaired: tuple[int, ...]
) -> JointRefinement:
    """The starts as they are."""
    one = np.asarray(1.0, np.float32)
    unknown = np.zeros((len(start), 6, 6), np.float32)
    return JointRefinement(start, unknown, result, (), held, unpaired, np.asarray(0, np.int32), one, one)
