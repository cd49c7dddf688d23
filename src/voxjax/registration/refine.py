"""Refinement of a pose on the surfaces of two maps, by optimistix (section IV.D)."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32

from .._checks import InputError, check_choice, check_pose, check_positive
from .._results import RESULTS
from .._types import Array
from ..grid import VoxelGrid
from ..refinement.covariance import PATCH_VOXELS, PRIOR, pose_covariance
from ..refinement.losses import Loss
from ..refinement.pose import solve_pose
from .prepared import PreparedMap, prepare_map
from .problem import plane_problem

START_DISTANCE, FINAL_DISTANCE = 4.0, 1.0
"""Robust scale of the first and of the last level [voxel]."""

LEVELS_PER_OCTAVE = 2
"""Levels while the robust scale halves."""


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

    T_a_b: Float[Array, "4 4"]
    covariance: Float[Array, "6 6"]
    result: RESULTS
    num_steps: Int32[Array, ""]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]


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
    problem = plane_problem(target, other, num_points=num_points, loss=loss, both_ways=both_ways)
    scales = robust_scales(first, last)
    found = solve_pose(problem, jnp.asarray(start), scales)
    num_patches = np.asarray(other.num_points / PATCH_VOXELS, np.float32)
    covariance, is_degenerate = pose_covariance(problem, found.T_a_b, scales[-1], num_patches)
    result = RESULTS.where(found.converged, RESULTS.successful, RESULTS.not_converged)
    return Refinement(
        T_a_b=found.T_a_b,
        covariance=covariance,
        result=RESULTS.where(is_degenerate, RESULTS.degenerate, result),
        num_steps=found.num_steps,
        cost_before=found.cost_before,
        cost_after=found.cost_after,
    )


def robust_scales(first: float, last: float) -> Float[np.ndarray, "levels"]:
    """Robust scale of each level, falling [m]."""
    num_levels = max(int(np.ceil(LEVELS_PER_OCTAVE * np.log2(first / last) - 1e-6)), 1)
    return np.geomspace(last, first, num_levels)[::-1].astype(np.float32)


def _prepared(grid: VoxelGrid) -> PreparedMap | None:
    """The map prepared, or None if nothing is occupied."""
    return prepare_map(grid) if grid.num_occupied else None


def _nothing_to_refine(start: np.ndarray) -> Refinement:
    """The start, with a covariance that says that nothing is known."""
    one = np.asarray(1.0, np.float32)
    unknown = np.eye(6, dtype=np.float32) * np.float32(PRIOR**2)
    return Refinement(start, unknown, RESULTS.empty_map, np.asarray(0, np.int32), one, one)
