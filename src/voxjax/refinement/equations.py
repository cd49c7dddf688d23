"""Normal equations: what a solver of few unknowns needs of many residuals."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Float

from .. import rigid
from .._types import Array
from .losses import robust_slope
from .terms import Level, PointTerm, Term, dot, robust_rows

LEAST_DAMPING = 1e-7
"""Keeps the system solvable in directions that no residual sees."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class NormalEquations(NamedTuple):
    """A least-squares problem to second order about one point.

    Attributes:
        cost: Half the sum of squares.
        slope: Its gradient.
        matrix: The Gauss-Newton approximation of its Hessian.
    """

    cost: Float[Array, ""]
    slope: Float[Array, "k"]
    matrix: Float[Array, "k k"]

    def step(self, damping: Float[Array, ""]) -> Float[Array, "k"]:
        """The damped step; 0 along what no residual sees."""
        diagonal = jnp.diagonal(self.matrix)
        floor = (
            jnp.asarray(LEAST_DAMPING, diagonal.dtype) * jnp.max(diagonal) + jnp.finfo(diagonal.dtype).tiny
        )
        damped = self.matrix + jnp.diag(damping * diagonal + floor)
        operator = lx.MatrixLinearOperator(damped, lx.positive_semidefinite_tag)
        return -lx.linear_solve(operator, self.slope, lx.Cholesky(), throw=False).value

    def along(self, slopes: Float[Array, "k m"]) -> "NormalEquations":
        """The same in other unknowns, with which these change by `slopes`."""
        return NormalEquations(self.cost, slopes.T @ self.slope, slopes.T @ self.matrix @ slopes)

    def fall(self, move: Float[Array, "k"]) -> Float[Array, ""]:
        """By how much the cost should fall with a step."""
        return -(self.slope @ move) - 0.5 * (move @ (self.matrix @ move))


def dense_equations(residuals: Callable[[Array], Any], y: Float[Array, "k"]) -> NormalEquations:
    """Normal equations of residuals (a tree of arrays) by forward mode."""
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
        if isinstance(term, PointTerm):
            found.append(_of_points(term, T_a_b, pivot, level))
        else:

            def rows(tangent: Array, term: Term = term) -> Array:
                return term.rows(move_about(T_a_b, centroid, tangent), level)

            found.append(dense_equations(rows, jnp.zeros(6, T_a_b.dtype)))
    return NormalEquations(*(sum(part[1:], start=part[0]) for part in zip(*found, strict=True)))


def move_about(
    T: Float[Array, "4 4"], centroid: Float[Array, "3"], tangent: Float[Array, "6"]
) -> Float[Array, "4 4"]:
    """`T` followed by a small motion about the image of `centroid`.

    Args:
        T: `T_a_b`.
        centroid: Of map b, in frame b [m].
        tangent: Translation [m] and rotation [rad] in frame a.
    """
    rotation = rigid.exp_so3(tangent[3:]) @ T[:3, :3]
    image = T[:3, :3] @ centroid + T[:3, 3] + tangent[:3]
    return rigid.from_rotation_translation(rotation, image - rotation @ centroid)


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
    ways = [push([placed.shift[i, j] * ones for i in range(3)]) for j in range(3)]
    pull = [slope * dot(way, offset) for way in ways]
    gram = [slope * dot(ways[i], ways[j]) for i, j in _PAIRS]
    products = [ones, *placed.arm, *(placed.arm[i] * placed.arm[j] for i, j in _PAIRS)]
    sums = jnp.stack(gram + pull) @ jnp.stack(products).T
    rows = robust_rows(offset, weights, term.loss)
    cost = 0.5 * jnp.sum(rows * rows, dtype=rows.dtype)
    return NormalEquations(cost, _slope(sums[6:]), _matrix(sums[:6]))


def _slope(sums: Float[Array, "3 10"]) -> Float[Array, "6"]:
    """Sums of `pull` and of `arm x pull`."""
    turn = [sums[(i + 2) % 3, 1 + (i + 1) % 3] - sums[(i + 1) % 3, 1 + (i + 2) % 3] for i in range(3)]
    return jnp.concatenate([sums[:, 0], jnp.stack(turn)])


def _matrix(sums: Float[Array, "6 10"]) -> Float[Array, "6 6"]:
    """The 6 x 6 matrix from sums of entries of gram times 1, arm and products of arms."""
    entry = {pair: k for k, pair in enumerate(_PAIRS)} | {(j, i): k for k, (i, j) in enumerate(_PAIRS)}

    def gram(i: int, j: int, product: int) -> Array:
        return sums[entry[i, j], product]

    # Column j of -hat(arm): the point moves by e_j x arm, so by +arm[c] along b and -arm[b] along c.
    def turned(j: int) -> list[tuple[int, int, float]]:
        b, c = (j + 1) % 3, (j + 2) % 3
        return [(c, b, 1.0), (b, c, -1.0)]

    top = [[gram(i, j, 0) for j in range(3)] for i in range(3)]
    mixed = [
        [sum(sign * gram(i, axis, 1 + arm) for axis, arm, sign in turned(j)) for j in range(3)]
        for i in range(3)
    ]
    low = [
        [
            sum(
                s * t * gram(axis, other, 4 + entry[arm, brm])
                for axis, arm, s in turned(i)
                for other, brm, t in turned(j)
            )
            for j in range(3)
        ]
        for i in range(3)
    ]
    upper = jnp.stack([jnp.stack(top[i] + mixed[i]) for i in range(3)])
    lower = jnp.stack([jnp.stack([mixed[k][i] for k in range(3)] + low[i]) for i in range(3)])
    return jnp.concatenate([upper, lower])
