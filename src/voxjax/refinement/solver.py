"""Least squares of few unknowns and many residuals, for optimistix: normal equations, damping, annealed scales.

`optimistix.LevenbergMarquardt` factors a tall Jacobian, or forms normal equations through a general linear operator,
and in float32 spends most of its steps on changes that rounding hides. This solver evaluates residuals and derivatives
once a step, keeps sums of the size of the unknowns, stops where rounding begins, and lets the robust scale shrink
inside of one compiled loop. To optimistix it is a solver like others, so its adjoints differentiate the solution.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Bool, Float, Int32

from .._types import Array

FIRST_DAMPING = 1e-3
"""Share of the diagonal that is added to it."""

LESS, MORE = 0.2, 8.0
"""Factors on the damping after a step that lowered the cost, and after one that did not."""

LEAST_MORE = 0.1
"""Damping after a step that did not lower the cost, at least: below it, steps hardly differ."""

MAX_STRETCH = 3.0
"""Steps are lengthened by up to so much where the cost keeps falling: matches follow the pose only in part, so that
Gauss-Newton steps are too short, by the same share each time."""

COARSE_STEP = 0.03
"""A level before the last one ends with a step below this [robust scale]: the next level moves the pose anyway."""

FLOOR = 10.0
"""A step that failed though it promised less than so many times the relative tolerance failed by rounding."""


Fn = Callable[[Array, Any], tuple[Any, None]]
"""Residuals of unknowns and arguments, as optimistix hands them over."""


class _State(eqx.Module):
    """Where the solver is.

    Attributes:
        candidate: The point to be evaluated next.
        met: What is looked up there. Carried by the loop, so that it is looked up once: a compiler may do so again for
            each of its uses.
        equations: At the best point so far; of infinite cost at the beginning of a level.
        damping: See `FIRST_DAMPING`.
        stretch: See `MAX_STRETCH`.
        fall: What the step should take off the cost unstretched.
        level: Number of the level.
        steps_left: Of this level.
        num_steps: Evaluations so far.
        is_done: No candidate is left.
        is_converged: Whether that was by a tolerance.
    """

    candidate: Array
    met: Any
    equations: Any
    damping: Float[Array, ""]
    stretch: Float[Array, ""]
    fall: Float[Array, ""]
    level: Int32[Array, ""]
    steps_left: Int32[Array, ""]
    is_done: Bool[Array, ""]
    is_converged: Bool[Array, ""]


class AnnealedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt on normal equations, one level after the other.

    Attributes:
        rtol: A promised fall of the cost below this share of it ends a level.
        atol: A step below this ends the last level.
        rough: A step below this that did not lower the cost ends a level: for costs that jump.
        lookup: `lookup(y, args)` gives what the residuals look up.
        equations: `equations(y, met, args, level)` gives the normal equations of the residuals on a level; those of
            the last level must be those of the function that optimistix is given.
        num_levels: Levels, the first being the coarsest.
        max_level_steps: Evaluations on each level.
    """

    rtol: float
    atol: float
    rough: float
    lookup: Callable[[Array, Any], Any] = eqx.field(static=True)
    equations: Callable[[Array, Any, Any, Array], Any] = eqx.field(static=True)
    num_levels: int = eqx.field(static=True)
    max_level_steps: int = eqx.field(static=True)
    norm: Callable = eqx.field(static=True, default=optx.max_norm)

    def init(
        self,
        fn: Fn,
        y: Array,
        args: Any,
        options: dict[str, Any],
        f_struct: Any,
        aux_struct: Any,
        tags: frozenset[object],
    ) -> _State:
        """Nothing is known: the first candidate is the start itself."""
        del fn, options, f_struct, aux_struct, tags
        level, zero = jnp.zeros((), jnp.int32), jnp.zeros((), y.dtype)
        met = self.lookup(y, args)
        struct = jax.eval_shape(lambda: self.equations(y, met, args, level))
        unknown = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), struct)
        return _State(
            y,
            met,
            unknown._replace(cost=jnp.full((), jnp.inf, y.dtype)),
            zero + FIRST_DAMPING,
            zero + 1.0,
            zero,
            level,
            jnp.full((), self.max_level_steps, jnp.int32),
            jnp.asarray(False),
            jnp.asarray(False),
        )

    def step(
        self,
        fn: Fn,
        y: Array,
        args: Any,
        options: dict[str, Any],
        state: _State,
        tags: frozenset[object],
    ) -> tuple[Array, _State, None]:
        """Evaluate the candidate, keep it if it is better, and find the next one."""
        del fn, options, tags
        before = state.equations.cost
        found = self.equations(state.candidate, state.met, args, state.level)
        is_better, is_fresh = found.cost < before, jnp.isinf(before)
        y = jnp.where(is_better, state.candidate, y)
        best = jax.tree.map(lambda new, old: jnp.where(is_better, new, old), found, state.equations)
        stretch = jnp.where(is_better & ~is_fresh, self._stretch(state, before - found.cost), 1.0)
        # A stretched step that failed is tried again as it was.
        is_too_long = ~is_better & (state.stretch <= 1.0)
        damping = state.damping * jnp.where(is_better & ~is_fresh, LESS, 1.0)
        damping = jnp.where(is_too_long, jnp.maximum(state.damping * MORE, LEAST_MORE), damping)

        move = best.step(damping)
        fall = best.fall(move)
        is_last = state.level == self.num_levels - 1
        least = jnp.where(is_last, self.atol, max(COARSE_STEP, self.atol))
        # A small step that failed met other matches than it was made for.
        least = jnp.where(is_better, least, jnp.maximum(least, self.rough))
        promise = jnp.where(is_better, self.rtol, FLOOR * self.rtol) * best.cost
        has_converged = (self.norm(move) < least) | (fall <= promise)
        is_over = has_converged | (state.steps_left <= 1)
        to_next = is_over & ~is_last
        # At the beginning of a level nothing is known of it, and the candidate is where the last one ended.
        candidate = jnp.where(to_next, y, y + stretch * move)
        return (
            y,
            _State(
                candidate,
                self.lookup(candidate, args),
                best._replace(cost=jnp.where(to_next, jnp.inf, best.cost)),
                jnp.where(to_next, FIRST_DAMPING, damping),
                stretch,
                fall,
                state.level + to_next.astype(jnp.int32),
                jnp.where(to_next, jnp.int32(self.max_level_steps), state.steps_left - 1),
                is_over & is_last,
                has_converged,
            ),
            None,
        )

    def terminate(
        self,
        fn: Fn,
        y: Array,
        args: Any,
        options: dict[str, Any],
        state: _State,
        tags: frozenset[object],
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether the last level is over."""
        del fn, y, args, options, tags
        return state.is_done, optx.RESULTS.successful

    def postprocess(
        self,
        fn: Fn,
        y: Array,
        aux: None,
        args: Any,
        options: dict[str, Any],
        state: _State,
        tags: frozenset[object],
        result: optx.RESULTS,
    ) -> tuple[Array, None, dict[str, Any]]:
        """Say whether the last level converged."""
        del fn, args, options, tags, result
        return y, aux, {"is_converged": state.is_converged}

    def _stretch(self, state: _State, fallen: Float[Array, ""]) -> Float[Array, ""]:
        """The length that would have been best for the last step, from what it brought."""
        promised = 2.0 * jnp.maximum(state.fall, jnp.finfo(fallen.dtype).tiny)
        bend = 2.0 * (state.stretch - fallen / promised) / state.stretch**2
        return jnp.where(
            bend > 1.0 / MAX_STRETCH,
            jnp.maximum(1.0 / jnp.maximum(bend, 1.0 / MAX_STRETCH), 1.0),
            MAX_STRETCH,
        )
