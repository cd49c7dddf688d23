"""The pose that minimises the residuals between two maps: differentiable, and safe under jit, vmap and grad."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int32

from ..._runtime.precision import in_full_precision
from ..._runtime.programs import kept_program
from ..._types import Array
from ..residuals.terms import Level
from .chart import chart_about
from .implicit import by_pseudo_inverse
from .levels import MAX_LEVEL_STEPS, Problem, lead, no_worse, precision_of, settle
from .problem import PoseProblem


class RefinedPose(NamedTuple):
    """Arrays that `solve_pose` gives.

    Attributes:
        T_a_b: Never worse than the start at the last level.
        cost_before: Cost of the start, at the last level.
        cost_after: Cost of `T_a_b`.
        num_steps: Evaluations, all levels together.
        converged: Whether the last level did.
    """

    T_a_b: Float[Array, "4 4"]
    cost_before: Float[Array, ""]
    cost_after: Float[Array, ""]
    num_steps: Int32[Array, ""]
    converged: Bool[Array, ""]


@kept_program
@eqx.filter_jit
@in_full_precision
def problem_cost(
    problem: Problem, poses: Float[Array, "*maps 4 4"], scales: Float[Array, "levels"]
) -> Float[Array, ""]:
    """Cost of a pose, or of many of a joint problem, at the last level."""
    return problem.cost(jnp.asarray(poses), Level(scales[-1], jnp.asarray(scales.shape[0] - 1, jnp.int32)))


@eqx.filter_jit
@in_full_precision
def find_basin(
    problem: PoseProblem,
    T_a_b: Float[Array, "4 4"],
    scales: Float[Array, "levels"],
    *,
    levels: tuple[int, int] | None = None,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> tuple[Float[Array, "4 4"], Int32[Array, ""]]:
    """The levels before the last one, on fewer points; without a derivative.

    Args:
        problem: As for `solve_pose`.
        T_a_b: Start.
        scales: Robust scale of each level, the last of which is left out [m].
        levels: The first level to take and the one to stop before; None for all but the last.
        max_level_steps: Evaluations on each level.

    Returns:
        A pose for `solve_pose` to begin the last level with, and the evaluations.
    """
    problem, start, scales = jax.lax.stop_gradient((problem, jnp.asarray(T_a_b), scales))
    first, stop = levels or (0, scales.shape[0] - 1)
    # A single level leaves nothing to lead along: the start is where the last level begins.
    if first >= stop:
        return start, jnp.zeros((), jnp.int32)
    # Steps are of order one on the finest of these levels.
    chart = chart_about(start, problem.centroid, problem.radius, scales[stop - 1])
    found, steps, _ = lead(problem, chart, scales, levels=(first, stop), max_level_steps=max_level_steps)
    return found, steps


@kept_program
@eqx.filter_jit
@in_full_precision
def find_basins(
    problem: PoseProblem,
    starts: Float[Array, "k 4 4"],
    count: Int32[Array, ""],
    scales: Float[Array, "levels"],
    *,
    levels: tuple[int, int] | None = None,
    max_level_steps: int = MAX_LEVEL_STEPS,
) -> tuple[Float[Array, "k 4 4"], Int32[Array, "k"]]:
    """`find_basin` of the first `count` starts, one after the other in one kernel; the other rows mean nothing.

    One call for many starts, because each call hands over all the arrays of the problem.
    """
    lead_one = partial(find_basin, problem, scales=scales, levels=levels, max_level_steps=max_level_steps)
    return _of_rows(lead_one, starts, count)


@kept_program
@eqx.filter_jit
@in_full_precision
def problem_costs(
    problem: PoseProblem,
    poses: Float[Array, "k 4 4"],
    count: Int32[Array, ""],
    scales: Float[Array, "levels"],
) -> Float[Array, "k"]:
    """`problem_cost` of the first `count` poses, as `find_basins`."""
    return _of_rows(partial(problem_cost, problem, scales=scales), poses, count)


def _of_rows(function: Callable[[Array], Any], rows: Array, count: Array) -> Any:
    """A function of each of the first `count` rows."""
    # The length of the loop is traced. `vmap` would let all rows wait for the slowest, and those that do not count too.
    shapes = jax.eval_shape(function, rows[0])
    nothing = jax.tree.map(lambda one: jnp.zeros((len(rows), *one.shape), one.dtype), shapes)

    def step(row: Array, found: Any) -> Any:
        return jax.tree.map(lambda all_rows, one: all_rows.at[row].set(one), found, function(rows[row]))

    return jax.lax.fori_loop(0, count, step, nothing)


@kept_program
@eqx.filter_jit
@in_full_precision
def solve_pose(
    problem: PoseProblem,
    T_a_b: Float[Array, "4 4"],
    scales: Float[Array, "levels"],
    *,
    max_level_steps: int = MAX_LEVEL_STEPS,
    is_led: bool = False,
) -> RefinedPose:
    """Minimise the residuals from a start: coarse to fine, then with the matches that were found held.

    The robust scale falls from level to level (graduated non-convexity) while matches are looked up anew at each step;
    levels before the last one use fewer points. At the end each point keeps what it meets, which leaves a smooth
    problem whose solution can be exact and be differentiated.

    The derivative is that of this solution, by the implicit function theorem (forward and reverse mode): with respect
    to everything floating in the problem and to the last scale. A solution does not depend on its start, so the
    derivative with respect to `T_a_b` is 0, unless a term holds the start (`Prior`), or the start is kept because no
    better pose was found. A kept start has the derivative of the solution if that is the same but for a small part of
    the scale, else none. Directions that nothing fixes have a derivative of 0; where the theorem's equation cannot be
    solved, as for values that are not finite, the derivative is NaN.

    Pass the problem as an argument into functions that are compiled around this: its tables would be large constants.

    Args:
        problem: Residuals; their dtype, float32 or float64, is that of the result.
        T_a_b: Start.
        scales: Robust scale of each level, falling [m].
        max_level_steps: Evaluations on each level.
        is_led: The start is what `find_basin` gave, and only the last level is left.

    References:
        Yang et al., Graduated Non-Convexity for Robust Spatial Perception, 2020; Blondel et al., Efficient and Modular
        Implicit Differentiation, 2022.
    """
    start = jnp.asarray(T_a_b)
    # The start only says where to look, so that no derivative comes from it; see above.
    found, steps = jax.lax.stop_gradient(start), jnp.zeros((), jnp.int32)
    if not is_led:
        found, steps = find_basin(problem, start, scales, max_level_steps=max_level_steps)
    # The last level uses all points and has units of its own scale.
    T, more, is_converged = settle(
        problem,
        chart_about(found, problem.centroid, problem.radius, scales[-1]),
        scales,
        max_level_steps=max_level_steps,
        solve=by_pseudo_inverse(precision_of(start.dtype).rank),
    )
    # Robust costs have several minima: the descent may end in one that is dearer than the start.
    return RefinedPose(*no_worse(problem, start, T, scales), steps + more, is_converged)
