"""Refinement from many starts: they are led to their basins on few points, and those that meet go on as one."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..._runtime.pieces import over_pieces
from ..._runtime.threads import num_cores, spread
from ..._types import Array
from ..solve.pose import RefinedPose, find_basins, problem_costs, solve_pose
from ..solve.problem import PoseProblem


def solve_starts(
    problem: PoseProblem, starts: Float[Array, "k 4 4"], scales: Float[Array, "levels"]
) -> RefinedPose:
    """`solve_pose` from each of many starts, at the price of few.

    One start after the other on each core: under `jax.vmap` all starts wait for the slowest, and what they write
    exceeds a CPU's cache. Each start is compared with its own result; starts without a better pose stay.

    Args:
        problem: The problem, see `solve_pose`.
        starts: Any number, at least one.
        scales: Robust scales of the levels, see `solve_pose`.

    Returns:
        Host arrays with a leading axis k. The steps are those on the way to a basin and in it.
    """
    starts, num_levels = np.asarray(starts), len(scales)
    poses, steps = starts, np.zeros(len(starts), np.int32)
    # Starts that met on the first level share the levels after it: most of the work is spent where few are left.
    for levels in ((0, 1), (1, num_levels - 1)):
        if levels[0] < levels[1] < num_levels:
            basin, chosen = _basins(poses, problem, float(scales[levels[0]]))
            led = _grouped(partial(find_basins, scales=scales, levels=levels), problem, poses[chosen])
            poses, steps = led[0][basin], steps + led[1][basin]
    # The last level uses all points, so starts that have met by now are joined once more before it.
    basin, chosen = _basins(poses, problem, float(scales[-1]))
    found = spread_solves(lambda row: solve_pose(problem, poses[row], scales, is_led=True), list(chosen))
    T, _, after, more, converged = (np.stack([np.asarray(one[k]) for one in found])[basin] for k in range(5))
    # Costs are those of the starts themselves: a basin found from one of them may be no better than another.
    before = _grouped(partial(problem_costs, scales=scales), problem, starts)[0]
    is_better = after < before
    return RefinedPose(
        np.where(is_better[:, None, None], T, starts),
        before,
        np.where(is_better, after, before),
        (steps + more).astype(np.int32),
        converged,
    )


def _grouped(kernel: Callable[..., Any], problem: PoseProblem, poses: np.ndarray) -> list[np.ndarray]:
    """What a kernel of a group of poses gives for any number of them: a part on each core, as host arrays."""
    # Starts of one call at most; how many of them there are is no part of its shape.
    size = 64
    group = min(-(-len(poses) // num_cores()), size)

    found = over_pieces(partial(kernel, problem), [poses], size=size, step=group, run=spread_solves)
    return jax.tree.leaves(found)


def spread_solves(function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
    """`spread` of solves, with the precision that the caller has set: JAX keeps it for each thread."""
    is_double = bool(jax.config.read("jax_enable_x64"))

    def run(item: Any) -> Any:
        with jax.enable_x64(is_double):
            return function(item)

    return spread(run, items)


def _basins(
    poses: Float[np.ndarray, "k 4 4"], problem: PoseProblem, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """For each pose the number of its basin, and for each basin the row of its first pose.

    `registration.hypotheses.distinct` chooses among hypotheses, degrees apart, by the trace of their rotations. Here
    poses are compared at fractions of a voxel, for which a trace in float32 has few digits left, and those that are not
    chosen have to know whom they follow.
    """
    # Poses that differ by less than this [robust scale of the next level], at the centroid and at
    # the map's radius, go on as one.
    same_shift = 0.1
    centroid, radius = np.asarray(problem.centroid), float(problem.radius)
    images = poses[:, :3, :3] @ centroid + poses[:, :3, 3]
    basin, chosen = np.full(len(poses), -1), []
    for row in range(len(poses)):
        if basin[row] >= 0:
            continue
        shift = np.linalg.norm(images - images[row], axis=1)
        # The chord of the turn between rotations; unlike an angle from the trace, it keeps its digits near 0.
        turn = np.linalg.norm(poses[:, :3, :3] - poses[row, :3, :3], axis=(1, 2)) / np.sqrt(2.0)
        is_same = (basin < 0) & (np.maximum(shift, turn * radius) < same_shift * scale)
        basin[is_same] = len(chosen)
        chosen.append(row)
    return basin, np.asarray(chosen)
