"""The pose that minimises the residuals between two maps: differentiable, and safe under jit, vmap and grad."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Int32, PyTree

from .._types import Array
from .equations import NormalEquations, move_about, pose_equations, tangent_slopes
from .solver import COARSE_STEP, AnnealedLevenbergMarquardt
from .terms import Level, Term

MAX_LEVEL_STEPS = 12
"""Evaluations of the residuals on each level, with matches looked up anew."""

MAX_LAST_STEPS = 24
"""Evaluations with matches that are held."""

FINE_STEP = 2e-3
"""Matches are held once a step is below this [robust scale]."""

COARSE_STRIDE = 8
"""Levels before the last one use one point in so many: they only lead to the basin."""

ATOL = {np.dtype(np.float32): 1e-4, np.dtype(np.float64): 1e-9}
"""The last step is below this [robust scale], by dtype."""

RTOL = {np.dtype(np.float32): 1e-6, np.dtype(np.float64): 1e-15}
"""Sums of squares are no more exact than this, by dtype."""

SAME_POSE = 0.02
"""Poses whose entries differ by less than this [last robust scale in metres] are one."""

RANK_TOLERANCE = {np.dtype(np.float32): 1e-5, np.dtype(np.float64): 1e-10}
"""Directions whose curvature is below this share of the largest are not fixed, and have no derivative."""


class PoseProblem(eqx.Module):
    """Residuals between two maps as a function of the pose of one in the other.

    Attributes:
        terms: Whose rows are squared and added.
        centroid: Of map b [m]: the point about which b is moved, so that translation and rotation are decoupled and
            float32 keeps its digits.
        radius: Length that makes radians comparable to metres: about that of map b [m].
    """

    terms: tuple[Term, ...]
    centroid: Float[Array, "3"]
    radius: Float[Array, ""]

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> tuple[Float[Array, "..."], ...]:
        """Rows of all terms."""
        return tuple(term.rows(T_a_b, level) for term in self.terms)

    def met(self, T_a_b: Float[Array, "4 4"]) -> tuple[PyTree, ...]:
        """What the points of each term meet under a pose."""
        return tuple(term.met(T_a_b) for term in self.terms)

    def holding(self, met: tuple[PyTree, ...]) -> "PoseProblem":
        """The problem with what the points meet held."""
        terms = [
            term if found is None else term.holding(found)
            for term, found in zip(self.terms, met, strict=True)
        ]
        return PoseProblem(tuple(terms), self.centroid, self.radius)

    def thinned(self, stride: int) -> "PoseProblem":
        """The problem with every `stride`-th point."""
        return PoseProblem(tuple(term.thinned(stride) for term in self.terms), self.centroid, self.radius)

    def cost(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, ""]:
        """Sum of the squares of all rows: the weighted mean of the losses where weights sum to 1."""
        return sum_of_squares(self.rows(T_a_b, level))


def sum_of_squares(rows: object) -> Float[Array, ""]:
    """Of all arrays of a tree."""
    parts = [jnp.sum(row * row, dtype=row.dtype) for row in jax.tree.leaves(rows)]
    return sum(parts[1:], start=parts[0])


class RefinedPose(NamedTuple):
    """Arrays that `solve_pose` gives.

    Attributes:
        T_a_b: Never worse than the start at the last level.
        cost_before: Of the start, at the last level.
        cost_after: Of `T_a_b`.
        num_steps: Evaluations, all levels together.
        converged: Whether the last level did.
    """

    T_a_b: Float[Array, "4 4"]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]
    num_steps: Int32[Array, ""]
    converged: Bool[Array, ""]


class _Chart(NamedTuple):
    """Poses as six unknowns around a start, in units in which their steps are of order one."""

    start: Float[Array, "4 4"]
    centroid: Float[Array, "3"]
    units: Float[Array, "6"]

    def pose(self, unknowns: Float[Array, "6"]) -> Float[Array, "4 4"]:
        return move_about(self.start, self.centroid, unknowns * self.units)

    def slopes(self, unknowns: Float[Array, "6"]) -> Float[Array, "6 6"]:
        """Tangent about the image of the centroid with a change of the unknowns."""
        return tangent_slopes(unknowns * self.units) * self.units[None, :]


class _Args(NamedTuple):
    """What residuals depend on beside the unknowns; those of optimistix are those at the last scale."""

    problem: PoseProblem
    chart: _Chart
    scales: Float[Array, "levels"]


def _residuals(unknowns: Float[Array, "6"], args: _Args) -> tuple[Array, ...]:
    level = Level(args.scales[-1], jnp.asarray(args.scales.shape[0] - 1, jnp.int32))
    return args.problem.rows(args.chart.pose(unknowns), level)


def _lookup(unknowns: Float[Array, "6"], args: _Args) -> tuple[PyTree, ...]:
    return args.problem.met(args.chart.pose(unknowns))


def _equations(
    unknowns: Float[Array, "6"], met: tuple[PyTree, ...], args: _Args, number: Int32[Array, ""]
) -> NormalEquations:
    problem, chart = args.problem.holding(met), args.chart
    T, level = chart.pose(unknowns), Level(args.scales[number], number)
    return pose_equations(problem.terms, T, problem.centroid, level).along(chart.slopes(unknowns))


def _solve(
    problem: PoseProblem,
    start: Float[Array, "4 4"],
    scales: Float[Array, "levels"],
    *,
    atol: float,
    rough: float = 0.0,
    max_level_steps: int,
) -> tuple[Float[Array, "4 4"], Int32[Array, ""], Bool[Array, ""]]:
    """Pose, evaluations, and whether the last level converged."""
    start, dtype = jax.lax.stop_gradient(start), start.dtype
    one = jnp.ones(3, dtype)
    units = jnp.concatenate([one, one / problem.radius]) * scales[-1]
    chart = _Chart(start, problem.centroid, jax.lax.stop_gradient(units))
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
    solution = optx.least_squares(
        _residuals,
        solver,
        jnp.zeros(6, dtype),
        _Args(problem, chart, scales),
        max_steps=num_levels * max_level_steps,
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.SVD(rcond=RANK_TOLERANCE[dtype])),
        tags=frozenset({lx.symmetric_tag}),
        throw=False,
    )
    steps = jnp.asarray(solution.stats["num_steps"], jnp.int32)
    return chart.pose(solution.value), steps, solution.stats["is_converged"]


@eqx.filter_jit
def problem_cost(
    problem: PoseProblem, T_a_b: Float[Array, "4 4"], scales: Float[Array, "levels"]
) -> Float[Array, ""]:
    """Cost of a pose at the last level."""
    return problem.cost(jnp.asarray(T_a_b), Level(scales[-1], jnp.asarray(scales.shape[0] - 1, jnp.int32)))


@eqx.filter_jit
def find_basin(
    problem: PoseProblem,
    T_a_b: Float[Array, "4 4"],
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> tuple[Float[Array, "4 4"], Int32[Array, ""]]:
    """The levels before the last one, on fewer points; without a derivative.

    Args:
        problem: As for `solve_pose`.
        T_a_b: Start.
        scales: Of all levels, the last of which is left out [m].
        max_level_steps: Evaluations on each level.

    Returns:
        A pose for `solve_pose` to begin the last level with, and the evaluations.
    """
    problem, start, scales = jax.lax.stop_gradient((problem, jnp.asarray(T_a_b), scales))
    if scales.shape[0] == 1:
        return start, jnp.zeros((), jnp.int32)
    thinned = problem.thinned(COARSE_STRIDE)
    found, steps, _ = _solve(thinned, start, scales[:-1], atol=COARSE_STEP, max_level_steps=max_level_steps)
    return found, steps


@eqx.filter_jit
def solve_pose(
    problem: PoseProblem,
    T_a_b: Float[Array, "4 4"],
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> RefinedPose:
    """Minimise the residuals from a start: coarse to fine, then with the matches that were found held.

    The robust scale falls from level to level (graduated non-convexity) while matches are looked up anew at each step;
    levels before the last one use fewer points. At the end each point keeps what it meets, which leaves a smooth
    problem whose solution can be exact and be differentiated.

    The derivative is that of this solution, by the implicit function theorem (forward and reverse mode): with respect
    to everything floating in the problem and to the last scale. A solution does not depend on its start, so the
    derivative with respect to `T_a_b` is 0, unless a term holds the start (`Prior`), or the start is kept because no
    better pose was found. A kept start has the derivative of the solution if that is the same but for a small part of
    the scale, else none. Directions that nothing fixes have a derivative of 0.

    Pass the problem as an argument into functions that are compiled around this: its tables would be large constants.

    Args:
        problem: Its dtype, float32 or float64, is that of the result.
        T_a_b: Start.
        scales: Robust scale of each level, falling [m].
        max_level_steps: Evaluations on each level.

    References:
        Yang et al., Graduated Non-Convexity for Robust Spatial Perception, 2020; Blondel et al., Efficient and Modular
        Implicit Differentiation, 2022.
    """
    start = jnp.asarray(T_a_b)
    dtype = start.dtype
    found, steps = find_basin(problem, start, scales, max_level_steps=max_level_steps)
    fixed, levels = jax.lax.stop_gradient((problem, scales))
    found, more, _ = _solve(
        fixed, found, levels[-1:], atol=FINE_STEP, rough=COARSE_STEP, max_level_steps=max_level_steps
    )
    matched = problem.holding(problem.met(jax.lax.stop_gradient(found)))
    T, last, is_converged = _solve(
        matched, found, scales[-1:], atol=ATOL[dtype], max_level_steps=MAX_LAST_STEPS
    )

    level = Level(scales[-1], jnp.asarray(scales.shape[0] - 1, jnp.int32))
    before, after = problem.cost(start, level), problem.cost(T, level)
    is_better = after < before
    # A start that is the solution but for rounding stays, with the derivative of the solution.
    is_same = jnp.max(jnp.abs(T - start)) < SAME_POSE * scales[-1]
    kept = start + jnp.where(is_same, T - jax.lax.stop_gradient(T), jnp.zeros_like(T))
    return RefinedPose(
        jnp.where(is_better, T, kept),
        before,
        jnp.where(is_better, after, before),
        steps + more + last,
        is_converged,
    )
