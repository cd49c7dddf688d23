"""The poses of N maps that minimise the residuals between them: differentiable, and safe under jit and grad."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Bool, Float, Int32, PyTree

from .._types import Array
from .equations import move_about, tangent_slopes
from .joint_equations import JointEquations
from .joint_problem import JointProblem
from .pose import (
    ATOL,
    COARSE_STRIDE,
    FINE_STEP,
    MAX_LAST_STEPS,
    MAX_LEVEL_STEPS,
    RANK_TOLERANCE,
    RTOL,
)
from .solver import COARSE_STEP, AnnealedLevenbergMarquardt
from .terms import Level

DIRECT_MAPS = 8
"""Up to so many maps the matrix of the implicit function theorem is made whole and decomposed, which takes a pass over
all residuals for each unknown; conjugate gradients take one for each of their steps."""


class RefinedPoses(NamedTuple):
    """Arrays that `solve_joint` gives.

    Attributes:
        poses: `T_world_map`, together never worse than the start at the last level.
        cost_before: Of the start, at the last level.
        cost_after: Of `poses`.
        num_steps: Evaluations, all levels together.
        converged: Whether the last level did.
    """

    poses: Float[Array, "maps 4 4"]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]
    num_steps: Int32[Array, ""]
    converged: Bool[Array, ""]


class _Charts(NamedTuple):
    """Poses as six unknowns a map around a start, in units in which their steps are of order one."""

    start: Float[Array, "maps 4 4"]
    centroids: Float[Array, "maps 3"]
    units: Float[Array, "maps 6"]
    is_fixed: Bool[Array, "maps"]

    def poses(self, unknowns: Float[Array, "maps 6"]) -> Float[Array, "maps 4 4"]:
        moved = jax.vmap(move_about)(self.start, self.centroids, unknowns * self.units)
        return jnp.where(self.is_fixed[:, None, None], self.start, moved)

    def slopes(self, unknowns: Float[Array, "maps 6"]) -> Float[Array, "maps 6 6"]:
        """Tangents about the images of the centroids with a change of the unknowns; 0 for maps that stay."""
        slopes = jax.vmap(tangent_slopes)(unknowns * self.units) * self.units[:, None, :]
        return jnp.where(self.is_fixed[:, None, None], jnp.zeros_like(slopes), slopes)


class _Args(NamedTuple):
    """What residuals depend on beside the unknowns; those of optimistix are those at the last scale."""

    problem: JointProblem
    charts: _Charts
    scales: Float[Array, "levels"]


def _residuals(unknowns: Float[Array, "maps 6"], args: _Args) -> tuple[PyTree, ...]:
    level = Level(args.scales[-1], jnp.asarray(args.scales.shape[0] - 1, jnp.int32))
    return args.problem.rows(args.charts.poses(unknowns), level)


def _lookup(unknowns: Float[Array, "maps 6"], args: _Args) -> tuple[PyTree, ...]:
    return args.problem.met(args.charts.poses(unknowns))


def _equations(
    unknowns: Float[Array, "maps 6"], met: tuple[PyTree, ...], args: _Args, number: Int32[Array, ""]
) -> JointEquations:
    poses, level = args.charts.poses(unknowns), Level(args.scales[number], number)
    return args.problem.holding(met).equations(poses, level).along(args.charts.slopes(unknowns))


def _solve(
    problem: JointProblem,
    start: Float[Array, "maps 4 4"],
    scales: Float[Array, "levels"],
    *,
    atol: float,
    rough: float = 0.0,
    max_level_steps: int,
) -> tuple[Float[Array, "maps 4 4"], Int32[Array, ""], Bool[Array, ""]]:
    """Poses, evaluations, and whether the last level converged."""
    start, dtype = jax.lax.stop_gradient(start), start.dtype
    one = jnp.ones((start.shape[0], 3), dtype)
    units = jnp.concatenate([one, one / problem.radii[:, None]], axis=1) * scales[-1]
    charts = _Charts(start, problem.centroids, jax.lax.stop_gradient(units), problem.is_fixed)
    num_levels = scales.shape[0]
    solver = AnnealedLevenbergMarquardt(
        rtol=RTOL[dtype],
        atol=atol,
        rough=rough,
        lookup=_lookup,
        equations=_equations,
        num_levels=num_levels,
        max_level_steps=max_level_steps,
    )
    tolerance = RANK_TOLERANCE[dtype]
    is_small = start.shape[0] <= DIRECT_MAPS
    solution = optx.least_squares(
        _residuals,
        solver,
        jnp.zeros((start.shape[0], 6), dtype),
        _Args(problem, charts, scales),
        max_steps=num_levels * max_level_steps,
        adjoint=optx.ImplicitAdjoint(
            linear_solver=lx.SVD(rcond=tolerance)
            if is_small
            else lx.CG(rtol=tolerance, atol=float(jnp.finfo(dtype).tiny))
        ),
        tags=frozenset({lx.symmetric_tag if is_small else lx.positive_semidefinite_tag}),
        throw=False,
    )
    steps = jnp.asarray(solution.stats["num_steps"], jnp.int32)
    return charts.poses(solution.value), steps, solution.stats["is_converged"]


@eqx.filter_jit
def solve_joint(
    problem: JointProblem,
    poses: Float[Array, "maps 4 4"],
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> RefinedPoses:
    """Minimise the residuals of all pairs from a start, as `solve_pose` does for one: coarse to fine, then held.

    The derivative is that of the solution by the implicit function theorem (forward and reverse mode): with respect to
    everything floating in the problem and to the last scale; that with respect to the start is 0. Directions that
    nothing fixes have a derivative of 0.

    Args:
        problem: With at least one pair; its dtype, float32 or float64, is that of the result.
        poses: Start: `T_world_map` of each map.
        scales: Robust scale of each level, falling [m].
        max_level_steps: Evaluations on each level.

    References:
        Pulli, Multiview Registration for Large Data Sets, 1999; Yang et al., Graduated Non-Convexity for Robust Spatial
        Perception, 2020.
    """
    start = jnp.asarray(poses)
    dtype = start.dtype
    fixed, levels = jax.lax.stop_gradient((problem, scales))
    found, steps = start, jnp.zeros((), jnp.int32)
    if scales.shape[0] > 1:
        found, more, _ = _solve(
            fixed.thinned(COARSE_STRIDE),
            found,
            levels[:-1],
            atol=COARSE_STEP,
            max_level_steps=max_level_steps,
        )
        steps = steps + more
    found, more, _ = _solve(
        fixed, found, levels[-1:], atol=FINE_STEP, rough=COARSE_STEP, max_level_steps=max_level_steps
    )
    matched = problem.holding(problem.met(jax.lax.stop_gradient(found)))
    refined, last, is_converged = _solve(
        matched, found, scales[-1:], atol=ATOL[dtype], max_level_steps=MAX_LAST_STEPS
    )

    level = Level(scales[-1], jnp.asarray(scales.shape[0] - 1, jnp.int32))
    before, after = problem.cost(start, level), problem.cost(refined, level)
    is_better = after < before
    return RefinedPoses(
        jnp.where(is_better, refined, start),
        before,
        jnp.where(is_better, after, before),
        steps + more + last,
        is_converged,
    )
