"""Derivative of a solution by the implicit function theorem, for kernels that JAX can keep between processes.

`optimistix.ImplicitAdjoint` solves the theorem's linear system by `lineax.linear_solve(throw=True)`, which raises
errors through a callback to the host, and JAX's persistent cache takes no kernel with such a callback. Here the outcome
of the linear solve is data: where it failed, the derivative is NaN.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jax.scipy.sparse.linalg import cg
from jaxtyping import Float, PyTree

from ..._runtime.precision import in_full_precision
from ..._types import Array

Matrix = Callable[[Array], Array]
"""A symmetric matrix as the function that multiplies an array of unknowns with it."""


@eqx.filter_custom_jvp
def implicit_solution(
    unknowns: Float[Array, "..."],
    inputs: PyTree,
    *,
    slope: Callable[[Array, Any], Array],
    solve: Callable[[Matrix, Array], Array],
) -> Float[Array, "..."]:
    """`unknowns` as they are, with the derivative of the point where `slope(unknowns, inputs)` is 0.

    Args:
        unknowns: Solution that a solver found; what it may depend on is not followed.
        inputs: All that the slope depends on beside the unknowns; forward and reverse mode work in its floating arrays.
        slope: Gradient of a cost in the unknowns, so that its Jacobian is symmetric.
        solve: `solve(matrix, right)` solves for the unknowns; `by_pseudo_inverse` or `by_conjugate_gradients`.

    Returns:
        `unknowns`. The derivative is NaN where the linear system was not solved, or where the slope is not finite.

    References:
        Blondel et al., Efficient and Modular Implicit Differentiation, 2022.
    """
    # The value is passed on; all that this function adds is its derivative, below.
    del inputs, slope, solve
    return unknowns


@implicit_solution.def_jvp
@in_full_precision
def _implicit_solution_jvp(
    primals: tuple[Array, PyTree],
    tangents: tuple[PyTree, PyTree],
    *,
    slope: Callable[[Array, Any], Array],
    solve: Callable[[Matrix, Array], Array],
) -> tuple[Array, Array]:
    unknowns, inputs = primals
    _, change = tangents
    # The rule differentiates at a solution that has this rule itself, so that second derivatives are right too.
    solution = implicit_solution(unknowns, inputs, slope=slope, solve=solve)
    # Inputs without a tangent, such as integers, cannot be pushed through `jax.jvp`.
    is_still = jax.tree.map(lambda tangent: tangent is None, change, is_leaf=lambda tangent: tangent is None)
    still, moving = eqx.partition(inputs, is_still)

    def slope_of_moving(moving: PyTree) -> Array:
        return slope(solution, eqx.combine(moving, still))

    # The slope stays 0 as inputs change: curvature times the change of the solution makes up for what they do
    # to it.
    _, slope_change = jax.jvp(slope_of_moving, (moving,), (change,))
    _, curvature = jax.linearize(lambda at: slope(at, inputs), solution)
    # JAX neither differentiates nor transposes `solve`, so it may look at its outcome; reverse mode calls it anew.
    # JAX asks the matrix for its name, for which `curvature` itself would print its whole program.
    return solution, -jax.lax.custom_linear_solve(
        lambda move: curvature(move), slope_change, solve, symmetric=True
    )


def by_pseudo_inverse(tolerance: float) -> Callable[[Matrix, Array], Array]:
    """A solver that makes the whole matrix and decomposes it; directions that nothing fixes get 0.

    Args:
        tolerance: Directions with less than this share of the largest singular value are not fixed.
    """
    return partial(_by_pseudo_inverse, tolerance=tolerance)


def _by_pseudo_inverse(matrix: Matrix, right: Array, *, tolerance: float) -> Array:
    operator = lx.FunctionLinearOperator(matrix, jax.eval_shape(lambda: right), lx.symmetric_tag)
    found = lx.linear_solve(operator, right, lx.SVD(rcond=tolerance), throw=False)
    return jnp.where(found.result == lx.RESULTS.successful, found.value, jnp.nan)


def by_conjugate_gradients(tolerance: float) -> Callable[[Matrix, Array], Array]:
    """A solver for a positive semidefinite matrix that is never made.

    Directions that nothing fixes get 0, if the right side has no part along them, as the slope of a cost has none.

    Args:
        tolerance: Share of the right side that may be left, in the Euclidean norm; lineax asks it of each entry, which
            rounding in float32 makes impossible for entries near 0.
    """
    return partial(_by_conjugate_gradients, tolerance=tolerance)


def _by_conjugate_gradients(matrix: Matrix, right: Array, *, tolerance: float) -> Array:
    # Exact arithmetic needs as many steps as there are unknowns; rounding needs some times more.
    found, _ = cg(matrix, right, tol=tolerance, maxiter=10 * right.size)
    left = jnp.linalg.norm(jnp.ravel(matrix(found) - right))
    # The residual that conjugate gradients carry along drifts from the true one by rounding: hence the factor.
    is_solved = left <= 10.0 * tolerance * jnp.linalg.norm(jnp.ravel(right))
    return jnp.where(is_solved, found, jnp.nan)
