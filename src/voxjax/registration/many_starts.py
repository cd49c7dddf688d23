"""Refinement from many starts: all are led to their basins on few points, and each basin is refined once."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from .._threads import spread
from .._types import Array
from ..refinement.pose import RefinedPose, find_basin, problem_cost, solve_pose
from ..refinement.problem import PoseProblem

SAME_SHIFT = 0.1
"""Poses on the way that differ by less than this [last robust scale], at the centroid and at the map's radius, are
one."""


def solve_starts(
    problem: PoseProblem, starts: Float[Array, "k 4 4"], scales: Float[Array, "levels"]
) -> RefinedPose:
    """`solve_pose` from each of many starts, at the price of few.

    One call after the other on each core: under `jax.vmap` all starts wait for the slowest, and what they write
    exceeds a CPU's cache. Each start is compared with its own result; starts without a better pose stay.

    Args:
        problem: As for `solve_pose`.
        starts: Any number, at least one.
        scales: As for `solve_pose`.

    Returns:
        Host arrays with a leading axis k. The steps are those on the way to a basin and in it.
    """
    starts = np.asarray(starts)
    led = spread_solves(lambda start: find_basin(problem, start, scales), list(starts))
    poses, steps = np.stack([np.asarray(pose) for pose, _ in led]), np.asarray([int(n) for _, n in led])
    basin, chosen = _basins(poses, np.asarray(problem.centroid), float(problem.radius), float(scales[-1]))
    found = spread_solves(lambda row: solve_pose(problem, poses[row], scales, is_led=True), list(chosen))
    T, _, after, more, converged = (np.stack([np.asarray(one[k]) for one in found])[basin] for k in range(5))
    before = np.stack(
        spread_solves(lambda start: np.asarray(problem_cost(problem, start, scales)), list(starts))
    )
    is_better = after < before
    return RefinedPose(
        np.where(is_better[:, None, None], T, starts),
        before,
        np.where(is_better, after, before),
        (steps + more).astype(np.int32),
        converged,
    )


def spread_solves(function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """`spread` of solves, with the precision that the caller has set: JAX keeps it for each thread."""
    is_double = bool(jax.config.read("jax_enable_x64"))

    def run(item: Any) -> Any:
        with jax.enable_x64(is_double):
            return function(item)

    return spread(run, items)


def _basins(
    poses: Float[np.ndarray, "k 4 4"], centroid: np.ndarray, radius: float, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """For each pose the number of its basin, and for each basin the row of its first pose."""
    images = poses[:, :3, :3] @ centroid + poses[:, :3, 3]
    basin, chosen = np.full(len(poses), -1), []
    for row in range(len(poses)):
        if basin[row] >= 0:
            continue
        shift = np.linalg.norm(images - images[row], axis=1)
        turn = np.linalg.norm(poses[:, :3, :3] - poses[row, :3, :3], axis=(1, 2)) / np.sqrt(2.0)
        is_same = (basin < 0) & (np.maximum(shift, turn * radius) < SAME_SHIFT * scale)
        basin[is_same] = len(chosen)
        chosen.append(row)
    return basin, np.asarray(chosen)
