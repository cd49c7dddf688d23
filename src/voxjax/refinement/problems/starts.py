"""Starts of a refinement: checked, and led along coarser maps to within the reach of the maps' own fields."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float

from ..._checks import InputError, check_pose
from ..._runtime.placement import to_device
from ..._types import Array
from ..residuals.losses import Loss
from ..solve.joint import solve_joint
from .coarse_to_fine import CoarseLevel, turned
from .joint import joint_problem
from .joint_pairs import Pair
from .many_starts import solve_starts, spread_solves
from .pair import pose_problem

Ways = TypeVar("Ways")
"""Poses that are led side by side, in the form in which the solver of a level takes and gives them."""


def checked_starts(name: str, poses: Sequence[object] | Array) -> Float[np.ndarray, "k 4 4"]:
    """Start poses, each checked by its number.

    Raises:
        InputError: If one is no rigid transform.
    """
    return np.stack([check_pose(f"{name}[{number}]", pose) for number, pose in enumerate(poses)])


def checked_start(name: str, T: object) -> Array:
    """One start (4, 4) or several (k, 4, 4); a traced one is taken as it is, because it has no values to check.

    Raises:
        InputError: If there is none, or one is no rigid transform.
    """
    if isinstance(T, jax.Array) and isinstance(T, Tracer):
        return T
    poses = np.asarray(T)
    # Anything that is no list of poses is checked, and refused, as a single one.
    if poses.ndim != 3:
        return check_pose(name, T)
    if not len(poses):
        raise InputError(f"{name} must hold at least one start, got none.")
    return checked_starts(name, poses)


def values_of_start(name: str, T: object) -> object:
    """A start as values: under `jax.grad` and `jax.jvp` those of what is traced.

    Raises:
        InputError: If it has none, under `jax.jit` and `jax.vmap`.
    """
    if not isinstance(T, jax.Array):
        return T
    values = jax.lax.stop_gradient(T)
    if isinstance(values, Tracer):
        raise InputError(
            f"{name} must be values, not traced by jit or vmap: they decide which maps overlap; compile "
            "`refinement.solve_joint` instead."
        )
    return values


def lead_pose(
    start: Array, centroid: Array, coarse: Sequence[CoarseLevel], *, loss: Loss, both_ways: bool
) -> Array:
    """Lead a start or several along coarser maps, to within the reach of the maps themselves.

    A single start goes with turned ones; the pose of least cost on the finest of the coarser maps is taken.

    Args:
        start: One pose, or several of which each is led for itself.
        centroid: Centroid of map b [m].
        coarse: Both maps, coarsened; without a level the start stays.
        loss: What a large offset costs.
        both_ways: Whether points of both maps are brought onto the other, as in `refine`.
    """
    # The solution does not depend on its start: no derivative goes this way.
    led = jax.lax.stop_gradient(to_device(start))
    if not coarse:
        return led

    def solve(level: CoarseLevel, poses: np.ndarray) -> tuple[np.ndarray, Array]:
        # Planes alone lead, whatever residuals follow: occupancies, for one, need a good start.
        problem = pose_problem(*level.maps, num_points=level.num_points, loss=loss, both_ways=both_ways)
        found = solve_starts(problem, poses, level.scales.astype(poses.dtype))
        return np.asarray(found.T_a_b), found.cost_after

    # Several starts are hypotheses of their own and stay apart; turns would multiply them.
    is_single = led.ndim == 2
    poses, costs = _along(coarse, np.asarray(turned(led, centroid) if is_single else led), solve)
    return jnp.asarray(poses[np.argmin(costs)] if is_single else poses)


def lead_poses(
    start: Float[Array, "maps 4 4"],
    centroids: Float[Array, "maps 3"],
    coarse: Sequence[CoarseLevel],
    numbers: Sequence[int],
    pairs: Sequence[Pair],
    is_held: Bool[np.ndarray, "maps"],
    loss: Loss,
) -> Float[Array, "maps 4 4"]:
    """Lead all poses together along coarser maps, to within the reach of the maps themselves.

    The starts go with turned ones, all maps alike that are not held, each about its own centroid; the poses of least
    cost on the finest of the coarser maps are taken.

    Args:
        start: `T_world_map` of all maps.
        centroids: Centroids of the maps [m].
        coarse: Coarser maps; without a level the starts stay.
        numbers: Number of the map that each of a level's maps was made of.
        pairs: Numbers of the maps that are held against each other.
        is_held: Which maps keep their pose.
        loss: What a large offset costs.
    """
    if not coarse:
        return start

    def solve(level: CoarseLevel, ways: list[Array]) -> tuple[list[Array], list[float]]:
        by_number = dict(zip(numbers, level.maps, strict=True))
        maps = [by_number.get(number) for number in range(len(start))]
        problem = joint_problem(maps, pairs, is_held, num_points=level.num_points, loss=loss)
        found = spread_solves(partial(solve_joint, problem, scales=level.scales.astype(start.dtype)), ways)
        return [each.poses for each in found], [float(each.cost_after) for each in found]

    # All maps turn alike: turning each for itself would take all combinations of turns.
    every_way = jnp.swapaxes(jax.vmap(turned)(start, centroids), 0, 1)
    ways, costs = _along(coarse, list(jnp.where(is_held[None, :, None, None], start[None], every_way)), solve)
    return ways[int(np.argmin(costs))]


def _along(
    coarse: Sequence[CoarseLevel],
    ways: Ways,
    solve: Callable[[CoarseLevel, Ways], tuple[Ways, Sequence[float] | Array]],
) -> tuple[Ways, Sequence[float] | Array]:
    """Solve on each level from what the level before gave; the poses and their costs on the last one."""
    costs: Sequence[float] | Array = ()
    for level in coarse:
        ways, costs = solve(level, ways)
    return ways, costs
