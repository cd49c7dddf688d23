"""Least squares of few unknowns and many residuals, for optimistix: normal equations, damping, annealed scales.

`optimistix.LevenbergMarquardt` factors a tall Jacobian, or forms normal equations through a general linear operator,
and in float32 spends most of its steps on changes that rounding hides. This solver evaluates residuals and derivatives
once a step, keeps sums of the size of the unknowns, stops where rounding begins, and lets the robust scale shrink
inside of one compiled loop, at whose end matches may be held. To optimistix it is a solver like others, so its adjoints
differentiate the solution.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Bool, Float, Int32

from ..._types import Array

Fn = Callable[[Array, Any], tuple[Any, None]]
"""Residuals of unknowns and arguments, as optimistix hands them over."""


class Stage(NamedTuple):
    """What ends a part of the descent; it begins where the one before ended.

    Attributes:
        level: Number of the robust scale.
        least: A step below this ends it [robust scale].
        max_steps: Evaluations at most.
        rough: A step below this that did not lower the cost ends it: for costs that jump [robust scale].
        is_held: Whether residuals keep what was looked up where the stage began.
    """

    level: int
    least: float
    max_steps: int
    rough: float = 0.0
    is_held: bool = False


class _State(eqx.Module):
    """Where the solver is.

    Attributes:
        candidate: The point to be evaluated next.
        place: Where residuals look things up: the candidate, or where a stage that holds them began.
        met: What is looked up there. Carried by the loop, so that it is looked up once: a compiler may do so again for
            each of its uses.
        equations: At the best point so far; of infinite cost at the beginning of a stage.
        damping: Share of the diagonal that is added to it.
        stretch: Factor on the length of the step, see `max_stretch` of the solver.
        fall: What the step should take off the cost unstretched.
        stage: Number of the stage.
        steps_left: Evaluations that are left to this stage.
        num_steps: Evaluations so far.
        is_done: No candidate is left.
        is_converged: Whether that was by a tolerance.
    """

    candidate: Array
    place: Array
    met: Any
    equations: Any
    damping: Float[Array, ""]
    stretch: Float[Array, ""]
    fall: Float[Array, ""]
    stage: Int32[Array, ""]
    steps_left: Int32[Array, ""]
    is_done: Bool[Array, ""]
    is_converged: Bool[Array, ""]


class AnnealedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt on normal equations, one stage after the other.

    Attributes:
        rtol: A promised fall of the cost below this share of it ends a stage.
        atol: The step that ends the last stage [robust scale].
        stages: Coarsest first.
        lookup: `lookup(y, args)` gives what the residuals look up.
        unknown: `unknown(y, args)` gives equations of infinite cost, from which the first evaluation begins.
        equations: `equations(y, met, args, level)` gives the normal equations of the residuals on a level; those of
            the last stage must be those of the function that is differentiated at the solution.
        norm: Size of a step.
        first_damping: Damping at the beginning of a stage: share of the diagonal that is added to it.
        less: Factor on the damping after a step that lowered the cost.
        more: Factor on the damping after one that did not.
        least_more: Damping after a step that did not lower the cost, at least: below it, steps hardly differ.
        max_stretch: Steps are lengthened by up to so much where the cost keeps falling: matches follow the pose only
            in part, so that Gauss-Newton steps are too short, by the same share each time.
        rounding: A step that failed though it promised less than so many times `rtol` failed by rounding.
    """

    rtol: float
    atol: float
    stages: tuple[Stage, ...] = eqx.field(static=True)
    lookup: Callable[[Array, Any], Any] = eqx.field(static=True)
    unknown: Callable[[Array, Any], Any] = eqx.field(static=True)
    equations: Callable[[Array, Any, Any, Array], Any] = eqx.field(static=True)
    norm: Callable = eqx.field(static=True, default=optx.max_norm)
    first_damping: float = eqx.field(static=True, default=1e-3)
    less: float = eqx.field(static=True, default=0.2)
    more: float = eqx.field(static=True, default=8.0)
    least_more: float = eqx.field(static=True, default=0.1)
    max_stretch: float = eqx.field(static=True, default=3.0)
    rounding: float = eqx.field(static=True, default=10.0)

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
        # Numbers of the state have the dtype of the unknowns: a loop's state may not change it from step to
        # step.
        zero = jnp.zeros((), y.dtype)
        return _State(
            candidate=y,
            place=y,
            met=self.lookup(y, args),
            equations=self.unknown(y, args),
            damping=zero + self.first_damping,
            stretch=zero + 1.0,
            fall=zero,
            stage=jnp.zeros((), jnp.int32),
            steps_left=jnp.full((), self.stages[0].max_steps, jnp.int32),
            is_done=jnp.asarray(False),
            is_converged=jnp.asarray(False),
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
        # The candidate is evaluated: cost, slope and matrix in one pass over the residuals.
        level, is_held, least, rough = (
            self._of_stages(name, state.stage) for name in ("level", "is_held", "least", "rough")
        )
        before = state.equations.cost
        found = self.equations(state.candidate, state.met, args, level)
        # The first evaluation of a stage is fresh: no step can be compared with what was known before.
        is_better, is_fresh = found.cost < before, jnp.isinf(before)
        # Everything is selected instead of branched on: under `vmap` starts are in different stages at the same
        # step.
        y = jnp.where(is_better, state.candidate, y)
        best = jax.tree.map(lambda new, old: jnp.where(is_better, new, old), found, state.equations)
        stretch = jnp.where(is_better & ~is_fresh, self._stretch(state, before - found.cost), 1.0)
        # A stretched step that failed is tried again as it was.
        is_too_long = ~is_better & (state.stretch <= 1.0)
        # Levenberg-Marquardt: less damping after a step that lowered the cost, more after one that did not.
        damping = state.damping * jnp.where(is_better & ~is_fresh, self.less, 1.0)
        damping = jnp.where(is_too_long, jnp.maximum(state.damping * self.more, self.least_more), damping)

        # The step starts from the best point, whether the candidate became that or not; only the damping
        # differs then.
        move = best.step(damping)
        fall = best.fall(move)
        # A small step that failed met other matches than it was made for.
        least = jnp.where(is_better, least, jnp.maximum(least, rough)).astype(y.dtype)
        # A step that failed and promised little failed by rounding: more damping would not help it.
        promise = jnp.where(is_better, self.rtol, self.rounding * self.rtol) * best.cost
        # A stage is over with a step that is too small, a promise that rounding would hide, or no evaluations left.
        has_converged = (self.norm(move) < least) | (fall <= promise)
        is_over = has_converged | (state.steps_left <= 1)
        is_last = state.stage == len(self.stages) - 1
        to_next = is_over & ~is_last
        # At the beginning of a stage nothing is known of it, and the candidate is where the last one ended.
        candidate = jnp.where(to_next, y, y + stretch * move)
        place, met = self._look(candidate, args, state, is_held)
        following = state.stage + to_next.astype(jnp.int32)
        return (
            y,
            _State(
                candidate=candidate,
                place=place,
                met=met,
                # Costs of different scales do not compare: infinity makes the first evaluation of the next
                # stage count as better.
                equations=best._replace(cost=jnp.where(to_next, jnp.inf, best.cost)),
                damping=jnp.where(to_next, self.first_damping, damping),
                stretch=stretch,
                fall=fall,
                stage=following,
                steps_left=jnp.where(to_next, self._of_stages("max_steps", following), state.steps_left - 1),
                is_done=is_over & is_last,
                # The last step overwrites what stages before said, so that this is of the last stage alone.
                is_converged=has_converged,
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
        """Whether the last stage is over."""
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
        """Say whether the last stage converged, and where it looked things up."""
        del fn, args, options, tags, result
        return y, aux, {"is_converged": state.is_converged, "place": state.place}

    def _of_stages(self, name: str, number: Int32[Array, ""]) -> Array:
        """An attribute of the stage of a number that is known at run time only."""
        # The look-up is part of the kernel, so that one loop is compiled for all stages.
        entry = jnp.asarray([getattr(stage, name) for stage in self.stages])[number]
        return entry.astype(jnp.int32) if jnp.issubdtype(entry.dtype, jnp.integer) else entry

    def _look(
        self, candidate: Array, args: Any, state: _State, is_held: Bool[Array, ""]
    ) -> tuple[Array, Any]:
        """Where the residuals of the candidate look things up, and what they find."""
        # Without a stage that holds, there is no branch: `cond` under `vmap` would compute both sides.
        if not any(stage.is_held for stage in self.stages):
            return candidate, self.lookup(candidate, args)
        return jax.lax.cond(
            is_held,
            lambda: (state.place, state.met),
            lambda: (candidate, self.lookup(candidate, args)),
        )

    def _stretch(self, state: _State, fallen: Float[Array, ""]) -> Float[Array, ""]:
        """The length that would have been best for the last step, from what it brought."""
        # The equations let a Gauss-Newton step fall by half of what its slope alone would take off: twice the
        # fall is that slope.
        promised = 2.0 * jnp.maximum(state.fall, jnp.finfo(fallen.dtype).tiny)
        # A parabola through the cost before, its slope and the cost after the step: its lowest point is at 1 / bend.
        bend = 2.0 * (state.stretch - fallen / promised) / state.stretch**2
        return jnp.where(
            bend > 1.0 / self.max_stretch,
            jnp.maximum(1.0 / jnp.maximum(bend, 1.0 / self.max_stretch), 1.0),
            self.max_stretch,
        )
