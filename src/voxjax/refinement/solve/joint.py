"""The poses of N maps that minimise the residuals between them: differentiable, and safe under jit and grad."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int32

from ..._runtime.precision import in_full_precision
from ..._types import Array
from .chart import chart_about
from .implicit import by_conjugate_gradients, by_pseudo_inverse
from .joint_problem import JointProblem
from .levels import MAX_LEVEL_STEPS, lead, no_worse, precision_of, settle

DIRECT_MAPS = 8
"""Up to so many maps the matrix of the implicit function theorem is made whole and decomposed, which takes a pass over
all residuals for each unknown; conjugate gradients take one for each of their steps."""


class RefinedPoses(NamedTuple):
    """Arrays that `solve_joint` gives.

    Attributes:
        poses: `T_world_map`, together never worse than the start at the last level.
        cost_before: Cost of the start, at the last level.
        cost_after: Cost of `poses`.
        num_steps: Evaluations, all levels together.
        converged: Whether the last level did.
    """

    poses: Float[Array, "maps 4 4"]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]
    num_steps: Int32[Array, ""]
    converged: Bool[Array, ""]


@eqx.filter_jit
@in_full_precision
def solve_joint(
    problem: JointProblem,
    poses: Float[Array, "maps 4 4"],
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> RefinedPoses:
    """Minimise the residuals of all pairs from a start, as `solve_pose` does for one: coarse to fine, then held.

    The derivative is that of the solution by the implicit function theorem (forward and reverse mode): with respect to
    everything floating in the problem and to the last scale; that with respect to the start is 0, as of one pose (see
    `solve_pose`). Directions that nothing fixes have a derivative of 0; where the theorem's equation
    cannot be solved, the derivative is NaN.

    Args:
        problem: Residuals of at least one pair; their dtype, float32 or float64, is that of the result.
        poses: Start: `T_world_map` of each map.
        scales: Robust scale of each level, falling [m].
        max_level_steps: Evaluations on each level.

    References:
        Pulli, Multiview Registration for Large Data Sets, 1999; Yang et al., Graduated Non-Convexity for Robust Spatial
        Perception, 2020.
    """
    start = jnp.asarray(poses)
    # As in `solve_pose`: thinned levels lead to the basin, each in units of the last of them; then all points settle.
    found, steps = start, jnp.zeros((), jnp.int32)
    if scales.shape[0] > 1:
        chart = chart_about(start, problem.centroids, problem.radii, scales[-2], is_fixed=problem.is_fixed)
        found, steps, _ = lead(problem, chart, scales, max_level_steps=max_level_steps)
    # Both solve for the derivative alone; steps of the descent have solvers of their own (`joint_equations`).
    # The number of maps is a shape, known when this is compiled: the kernel holds one of the two.
    solver = by_pseudo_inverse if start.shape[0] <= DIRECT_MAPS else by_conjugate_gradients
    refined, more, is_converged = settle(
        problem,
        chart_about(found, problem.centroids, problem.radii, scales[-1], is_fixed=problem.is_fixed),
        scales,
        max_level_steps=max_level_steps,
        solve=solver(precision_of(start.dtype).rank),
    )
    return RefinedPoses(*no_worse(problem, start, refined, scales), steps + more, is_converged)
