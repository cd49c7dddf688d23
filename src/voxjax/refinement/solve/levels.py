"""From a start to a solution, of one pose or of many: coarse to fine, then with matches held, then differentiated."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Int32, PyTree

from ..._types import Array
from ..residuals.terms import Level
from .chart import Chart
from .implicit import Matrix, implicit_solution
from .problem import sum_of_squares
from .solver import AnnealedLevenbergMarquardt, Stage

MAX_LEVEL_STEPS = 12
"""Evaluations of the residuals on each level, with matches looked up anew."""

_COARSE_STEP = 0.03
"""A stage whose costs jump ends with a step below this [robust scale]: the next one moves the pose anyway."""


class Precision(NamedTuple):
    """How exact a solution can be in a floating dtype.

    Attributes:
        step: The last step is below this [robust scale].
        cost: Share of a sum of squares that rounding hides.
        rank: Directions whose curvature is below this share of the largest are not fixed, and have no derivative.
    """

    step: float
    cost: float
    rank: float


def precision_of(dtype: np.typing.DTypeLike) -> Precision:
    """The precision of float32 or float64."""
    single, double = Precision(1e-4, 1e-6, 1e-5), Precision(1e-9, 1e-15, 1e-10)
    # Any other dtype is refused by the missing key.
    return {np.dtype(np.float32): single, np.dtype(np.float64): double}[np.dtype(dtype)]


@runtime_checkable
class Problem(Protocol):
    """Residuals as a function of a pose, or of many; see `PoseProblem` and `JointProblem`."""

    def rows(self, poses: Array, level: Level, /) -> PyTree:
        """Residuals."""
        ...

    def cost(self, poses: Array, level: Level, /) -> Array:
        """Sum of the squares of all residuals."""
        ...

    def met(self, poses: Array, /) -> tuple[PyTree, ...]:
        """What the points meet."""
        ...

    def holding(self, met: tuple[PyTree, ...], /) -> "Problem":
        """The problem with that held."""
        ...

    def thinned(self, stride: int, /) -> "Problem":
        """The problem with every `stride`-th point."""
        ...

    def equations(self, poses: Array, level: Level, /) -> Any:
        """Normal equations of the tangents."""
        ...

    def no_equations(self, dtype: Any, /) -> Any:
        """What is known before the first evaluation."""
        ...


class Descent(NamedTuple):
    """Where a descent ended.

    Attributes:
        poses: One or many.
        num_steps: Evaluations.
        is_converged: Whether the last stage did.
    """

    poses: Float[Array, "..."]
    num_steps: Int32[Array, ""]
    is_converged: Bool[Array, ""]


class _Args(NamedTuple):
    """What residuals depend on beside the unknowns."""

    problem: Any
    chart: Any
    scales: Float[Array, "levels"]

    def level(self, number: Int32[Array, ""]) -> Level:
        return Level(self.scales[number], number)

    def last_level(self) -> Level:
        return self.level(jnp.asarray(self.scales.shape[0] - 1, jnp.int32))


def lead(
    problem: Problem,
    chart: Chart,
    scales: Float[Array, "levels"],
    *,
    levels: tuple[int, int] | None = None,
    max_level_steps: int,
    stride: int = 8,
) -> Descent:
    """Go down the levels before the last one, or from one of them to before another; without a derivative.

    Args:
        problem: Residuals.
        chart: Chart of the poses, about where they are now.
        scales: Robust scale of each level [m].
        levels: The first level to take and the one to stop before; None for all but the last.
        max_level_steps: Evaluations on each level.
        stride: One point in so many is used, because these levels only lead to the basin.
    """
    # The last level belongs to `settle`, which uses all points.
    first, stop = levels or (0, scales.shape[0] - 1)
    stages = [Stage(k, _COARSE_STEP, max_level_steps) for k in range(first, stop)]
    # A solution does not depend on the way to it: nothing here is differentiated.
    args = jax.lax.stop_gradient(_Args(problem.thinned(stride), chart, scales))
    return _descend(args, tuple(stages)).at(args.chart)


def settle(
    problem: Problem,
    chart: Chart,
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int,
    solve: Callable[[Matrix, Array], Array],
    max_held_steps: int = 24,
    held_from: float = 2e-3,
) -> Descent:
    """Go down the last level, then on with what the points meet there held.

    Held matches leave a smooth cost, so that the solution can be exact and be differentiated.

    Args:
        problem: Residuals, in whose floating arrays the solution is differentiable.
        chart: Chart of the poses, about where they are now.
        scales: Robust scale of each level, of which the last one is used [m].
        max_level_steps: Evaluations with matches looked up anew.
        solve: Solver for the linear system of the implicit function theorem, see `implicit_solution`.
        max_held_steps: Evaluations with matches held.
        held_from: Matches are held once a step is below this [robust scale].
    """
    last, dtype = scales.shape[0] - 1, chart.units.dtype
    stages = (
        # First matches follow the pose and the cost jumps; then they are held, down to what rounding allows.
        Stage(last, held_from, max_level_steps, rough=_COARSE_STEP),
        Stage(last, precision_of(dtype).step, max_held_steps, is_held=True),
    )
    args = _Args(problem, jax.lax.stop_gradient(chart), scales)
    end = _descend(jax.lax.stop_gradient(args), stages)
    # The derivative is that of the equation that the solution fulfils, not that of the steps that found it.
    unknowns = implicit_solution(end.unknowns, (args, end.place), slope=_slope_of_held, solve=solve)
    return end._replace(unknowns=unknowns).at(args.chart)


def no_worse(
    problem: Problem,
    start: Float[Array, "*maps 4 4"],
    found: Float[Array, "*maps 4 4"],
    scales: Array,
    *,
    same_pose: float = 0.02,
) -> tuple[Float[Array, "*maps 4 4"], Float[Array, ""], Float[Array, ""]]:
    """What was found, or the start where that costs as little at the last level; the costs of the start and of these.

    A start that is the solution but for rounding stays, with the derivative of the solution: else a second refinement
    of a refined pose would have none.

    Args:
        problem: Residuals.
        start: Poses before.
        found: Poses that a descent from there found.
        scales: Robust scale of each level [m].
        same_pose: Poses whose entries differ by less than this [last robust scale in metres] are one.
    """
    level = Level(scales[-1], jnp.asarray(scales.shape[0] - 1, jnp.int32))
    # Both costs are of all points at one scale: those on the way are of fewer points, or of wider scales.
    before, after = problem.cost(start, level), problem.cost(found, level)
    is_better = after < before
    # Rounding decides between poses this near: both are the solution.
    is_same = jnp.max(jnp.abs(found - start)) < same_pose * scales[-1]
    # The difference is 0, but has the derivative of what was found.
    kept = start + jnp.where(is_same, found - jax.lax.stop_gradient(found), jnp.zeros_like(found))
    return jnp.where(is_better, found, kept), before, jnp.where(is_better, after, before)


class _End(NamedTuple):
    """Where the solver ended, in unknowns.

    Attributes:
        unknowns: The best point.
        place: The point where its residuals looked things up.
        num_steps: Evaluations.
        is_converged: Whether the last stage did.
    """

    unknowns: Array
    place: Array
    num_steps: Int32[Array, ""]
    is_converged: Bool[Array, ""]

    def at(self, chart: Chart) -> Descent:
        """The end as poses of a chart."""
        return Descent(chart.poses(self.unknowns), self.num_steps, self.is_converged)


def _descend(args: _Args, stages: tuple[Stage, ...]) -> _End:
    # Units of the chart are of one robust scale, so that tolerances of steps are shares of it, whatever the
    # maps' sizes are.
    units = args.chart.units
    solver = AnnealedLevenbergMarquardt(
        rtol=precision_of(units.dtype).cost,
        atol=stages[-1].least,
        stages=stages,
        lookup=_lookup,
        unknown=_unknown,
        equations=_equations,
    )
    # The outcome is data (`throw=False`): one start that fails must not end a batch, and callbacks keep kernels out of
    # JAX's cache.
    solution = optx.least_squares(
        _residuals,
        solver,
        jnp.zeros_like(units),
        args,
        max_steps=sum(stage.max_steps for stage in stages),
        throw=False,
    )
    stats = solution.stats
    return _End(
        solution.value, stats["place"], jnp.asarray(stats["num_steps"], jnp.int32), stats["is_converged"]
    )


def _residuals(unknowns: Array, args: _Args) -> PyTree:
    return args.problem.rows(args.chart.poses(unknowns), args.last_level())


def _lookup(unknowns: Array, args: _Args) -> tuple[PyTree, ...]:
    return args.problem.met(args.chart.poses(unknowns))


def _unknown(unknowns: Array, args: _Args) -> Any:
    return args.problem.no_equations(unknowns.dtype)


def _equations(unknowns: Array, met: tuple[PyTree, ...], args: _Args, number: Int32[Array, ""]) -> Any:
    poses = args.chart.poses(unknowns)
    # Equations are made at the pose itself and taken to the unknowns of the chart by the chain rule.
    return args.problem.holding(met).equations(poses, args.level(number)).along(args.chart.slopes(unknowns))


def _slope_of_held(unknowns: Array, held: tuple[_Args, Array]) -> Array:
    """Slope in the unknowns of the cost whose residuals hold what they met at a place; 0 at the solution."""
    args, place = held
    # Matches are looked up anew, from values that are differentiated: what is met carries derivatives of planes and
    # fields.
    problem = args.problem.holding(_lookup(place, args))

    def cost(unknowns: Array) -> Array:
        return 0.5 * sum_of_squares(problem.rows(args.chart.poses(unknowns), args.last_level()))

    return jax.grad(cost)(unknowns)
