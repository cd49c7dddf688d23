"""What refinement gives: poses, how sure they are, how the solver ended, and what the poses cost before and after."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32

from .._results import RESULTS
from .._types import Array


class Refinement(eqx.Module):
    """Outcome of `voxjax.refine`; every array with a leading axis k if there were k starts.

    Attributes:
        T_a_b: float64 (4, 4), under JAX's transformations what JAX has: maps points of b into a. Never worse than the
            start under the cost.
        covariance: float32 (6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of map
            b expressed in frame a.
        result: `successful`, `not_converged`, `degenerate` or `empty_map`.
        num_steps: Evaluations of the residuals, all levels together.
        cost_before: Robust cost of the start, in [0, 1] for bounded losses.
        cost_after: Robust cost of `T_a_b`.
    """

    T_a_b: Float[Array, "*starts 4 4"]
    covariance: Float[Array, "*starts 6 6"]
    result: RESULTS
    num_steps: Int32[Array, "*starts"]
    cost_before: Float[Array, "*starts"]
    cost_after: Float[Array, "*starts"]


class JointRefinement(eqx.Module):
    """Outcome of `voxjax.refine_joint`.

    Attributes:
        poses: float64 (maps, 4, 4) `T_world_map`; under JAX's transformations what JAX has. Together they are never
            worse than the start under the cost. Maps in `held` have the pose that they had.
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
        cost_after: Mean over the pairs of the robust cost of `poses`.
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


def has_ended(converged: Bool[Array, "*starts"], cost: Float[Array, "*starts"]) -> Bool[Array, "*starts"]:
    """Whether a solver came to an end at a cost that is a number: steps that change NaN by nothing end, too."""
    return jnp.asarray(converged) & jnp.isfinite(jnp.asarray(cost))


def how_it_ended(converged: Bool[Array, ""], is_degenerate: Bool[Array, ""]) -> RESULTS:
    """The result of a solve: a pose that can slide is `degenerate`, whether the solver converged or not."""
    # The outcome may be traced, so it is selected and not branched on.
    ended = RESULTS.where(converged, RESULTS.successful, RESULTS.not_converged)
    return RESULTS.where(is_degenerate, RESULTS.degenerate, ended)


def unrefined_pose(start: Float[Array, "*starts 4 4"]) -> Refinement:
    """Outcome for a map without an occupied voxel: the start, with a covariance that says that nothing is known."""
    batch = start.shape[:-2]
    result = RESULTS.empty_map
    if batch:
        # A RESULTS of several outcomes can only be made by selecting.
        choose = jax.vmap(lambda is_known: RESULTS.where(is_known, RESULTS.successful, RESULTS.empty_map))
        result = choose(jnp.zeros(batch, bool))
    # There is no voxel whose size could say how little is known, as `pose_covariance` has it: a metre, and a radian.
    unknown = np.broadcast_to(np.eye(6, dtype=np.float32), (*batch, 6, 6))
    return Refinement(start, unknown, result, *_without_a_step(batch))


def unrefined_poses(
    start: Float[np.ndarray, "maps 4 4"],
    result: RESULTS,
    held: tuple[int, ...],
    unpaired: tuple[int, ...],
) -> JointRefinement:
    """Outcome without a pair of maps: the starts, all held and therefore without a covariance."""
    covariance = np.zeros((len(start), 6, 6), np.float32)
    # No pair was held against each other, so that no map was moved.
    return JointRefinement(start, covariance, result, (), held, unpaired, *_without_a_step(()))


def _without_a_step(batch: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps taken, cost before and cost after where nothing supports a pose: it costs as much as it can."""
    cost = np.ones(batch, np.float32)
    return np.zeros(batch, np.int32), cost, cost
