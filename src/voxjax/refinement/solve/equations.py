"""Normal equations: what a solver of few unknowns needs of many residuals."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Float

from ... import rigid
from ..._types import Array
from ..residuals.losses import robust_slope
from ..residuals.terms import Level, PointTerm, Term, dot, robust_rows

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Entries of a symmetric 3 x 3 matrix that are kept."""


class NormalEquations(NamedTuple):
    """A least-squares problem to second order about one point.

    Attributes:
        cost: Half the sum of squares.
        slope: Gradient of the cost.
        matrix: The Gauss-Newton approximation of its Hessian.
    """

    cost: Float[Array, ""]
    slope: Float[Array, "k"]
    matrix: Float[Array, "k k"]

    def step(self, damping: Float[Array, ""]) -> Float[Array, "k"]:
        """The damped step; 0 along what no residual sees."""
        diagonal = jnp.diagonal(self.matrix)
        # The floor keeps the system solvable in directions that no residual sees.
        floor = jnp.asarray(1e-7, diagonal.dtype) * jnp.max(diagonal) + jnp.finfo(diagonal.dtype).tiny
        # Damping is a share of each unknown's own curvature, so that it means the same in metres and in
        # radians.
        damped = jnp.asarray(self.matrix) + jnp.diag(damping * diagonal + floor)
        operator = lx.MatrixLinearOperator(damped, lx.positive_semidefinite_tag)
        return -lx.linear_solve(operator, self.slope, lx.Cholesky(), throw=False).value

    def along(self, slopes: Float[Array, "k m"]) -> "NormalEquations":
        """The equations in other unknowns, with which these change by `slopes`."""
        return NormalEquations(
            self.cost, slopes.T @ self.slope, jnp.asarray(slopes.T @ (self.matrix @ slopes))
        )

    def fall(self, move: Float[Array, "k"]) -> Float[Array, ""]:
        """The fall of the cost that the equations promise for a step."""
        return -(self.slope @ move) - 0.5 * (move @ (self.matrix @ move))


def dense_equations(residuals: Callable[[Array], Any], y: Float[Array, "k"]) -> NormalEquations:
    """Normal equations of residuals (a tree of arrays) by forward mode."""
    # There are few unknowns and many residuals: forward passes, one for each unknown, are the fewest.
    values, push = jax.linearize(residuals, y)
    columns = jax.vmap(push)(jnp.eye(y.size, dtype=y.dtype))
    cost, slope, matrix = jnp.zeros((), y.dtype), jnp.zeros_like(y), jnp.zeros((y.size, y.size), y.dtype)
    for value, column in zip(jax.tree.leaves(values), jax.tree.leaves(columns), strict=True):
        flat = column.reshape(y.size, -1)
        cost = cost + 0.5 * jnp.sum(value * value, dtype=y.dtype)
        slope = slope + flat @ value.reshape(-1)
        matrix = matrix + flat @ flat.T
    return NormalEquations(cost, slope, matrix)


def pose_equations(
    terms: Sequence[Term], T_a_b: Float[Array, "4 4"], centroid: Float[Array, "3"], level: Level
) -> NormalEquations:
    """Normal equations of the tangent (translation [m], rotation [rad]) about the image of `centroid` in frame a."""
    pivot = T_a_b[:3, :3] @ centroid + T_a_b[:3, 3]
    found = []
    for term in terms:
        # Terms of points have their sums in closed form; any other term is differentiated in the six unknowns.
        if isinstance(term, PointTerm):
            found.append(_of_points(term, T_a_b, pivot, level))
        else:

            def rows(tangent: Array, term: Term = term) -> Array:
                return term.rows(move_about(T_a_b, centroid, tangent), level)

            found.append(dense_equations(rows, jnp.zeros(6, T_a_b.dtype)))
    return jax.tree.map(lambda *parts: sum(parts[1:], start=parts[0]), *found)


def move_about(
    T: Float[Array, "4 4"], centroid: Float[Array, "3"], tangent: Float[Array, "6"]
) -> Float[Array, "4 4"]:
    """`T` followed by a small motion about the image of `centroid`.

    Args:
        T: `T_a_b`.
        centroid: Centroid of map b, in frame b [m].
        tangent: Translation [m] and rotation [rad] in frame a.
    """
    rotation = rigid.exp_so3(tangent[3:]) @ T[:3, :3]
    # The image of the centroid moves by the shift alone, whatever the turn is.
    image = T[:3, :3] @ centroid + T[:3, 3] + tangent[:3]
    return rigid.from_rotation_translation(rotation, image - rotation @ centroid)


def tangent_slopes(tangent: Float[Array, "6"]) -> Float[Array, "6 6"]:
    """The small motion after `tangent` that a change of `tangent` makes, both about the image of the centroid."""
    shifts = jnp.eye(3, dtype=tangent.dtype)
    # The translation that `exp` gives is the left Jacobian of the rotation times what it is given.
    left = jax.vmap(lambda shift: rigid.exp(jnp.concatenate([shift, tangent[3:]]))[:3, 3], out_axes=1)(shifts)
    return jax.scipy.linalg.block_diag(shifts, left)


def _of_points(
    term: PointTerm, T_a_b: Float[Array, "4 4"], pivot: Float[Array, "3"], level: Level
) -> NormalEquations:
    """Normal equations of robust offsets, each weighted by the slope of its loss.

    A point has three derivatives instead of six, and sums of products with the arms stand for a Jacobian: offsets move
    with the point as `A`, the point with the tangent as `[I, -hat(arm)]`, so that the matrix consists of sums of the
    six entries of `A^T A` times the ten products of two of (1, arm).

    References:
        Holland and Welsch, Robust regression using iteratively reweighted least-squares, 1977.
    """
    placed, weights = term.placed(T_a_b, pivot), term.weights()
    offset, push = jax.linearize(lambda points: term.offsets(points, level), list(placed.points))
    squared = dot(offset, offset)
    slope = weights * robust_slope(squared, term.loss)
    ones = jnp.ones_like(squared)
    # A: how the offsets change as map b is shifted along each axis of frame a.
    ways = [push([placed.shift[i, j] * ones for i in range(3)]) for j in range(3)]
    # These are A^T r and the six entries of A^T A, weighted by what the loss leaves of each point.
    pull = [slope * dot(way, offset) for way in ways]
    gram = [slope * dot(ways[i], ways[j]) for i, j in _PAIRS]
    # One product of matrices sums them all, with 1, the arms and the products of two arms.
    products = [ones, *placed.arm, *(placed.arm[i] * placed.arm[j] for i, j in _PAIRS)]
    sums = jnp.stack(gram + pull) @ jnp.stack(products).T
    # The cost is the robust loss itself, not the weighted squares: the solver compares costs between steps.
    rows = robust_rows(offset, weights, term.loss)
    cost = 0.5 * jnp.sum(rows * rows, dtype=rows.dtype)
    found = jnp.asarray(_sums_to_equations(), sums.dtype) @ sums.reshape(-1)
    return NormalEquations(cost, found[:6], found[6:].reshape(6, 6))


@functools.cache
def _sums_to_equations() -> np.ndarray:
    """Constants that turn the sums into slope and matrix: float64 (42, 90)."""
    # Symmetric matrices are kept as six entries; both orders of a pair lead to the same one.
    entry = {pair: k for k, pair in enumerate(_PAIRS)} | {(j, i): k for k, (i, j) in enumerate(_PAIRS)}

    def moves(unknown: int) -> list[tuple[int, int | None, float]]:
        """Axes along which a point moves with an unknown, the part of its arm (None: 1), and the sign."""
        if unknown < 3:
            return [(unknown, None, 1.0)]
        # A turn about axis k moves a point by e_k x arm: along c with the arm's b, along b against the arm's c.
        b, c = (unknown - 2) % 3, (unknown - 1) % 3
        return [(c, b, 1.0), (b, c, -1.0)]

    def product(left: int | None, right: int | None) -> int:
        known = [arm for arm in (left, right) if arm is not None]
        return 0 if not known else 1 + known[0] if len(known) == 1 else 4 + entry[known[0], known[1]]

    weights = np.zeros((42, 9, 10))
    for i in range(6):
        for axis, arm, sign in moves(i):
            # Rows 0 to 5 are the slope, the others the matrix; columns are gram and pull (9) times products (10).
            weights[i, 6 + axis, product(arm, None)] += sign
            for j in range(6):
                for other, brm, turn in moves(j):
                    weights[6 + 6 * i + j, entry[axis, other], product(arm, brm)] += sign * turn
    return weights.reshape(42, 90)
