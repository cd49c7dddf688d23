"""Residuals between two maps as a function of the pose of one in the other."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float, PyTree

from ..._types import Array
from ..residuals.terms import Level, Term
from .equations import NormalEquations, pose_equations


class PoseProblem(eqx.Module):
    """Residuals between two maps as a function of the pose of one in the other.

    Attributes:
        terms: Terms whose rows are squared and added.
        centroid: Centroid of map b [m], about which b is moved, so that translation and rotation are decoupled
            and float32 keeps its digits.
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
            # Continuous terms look nothing up: they are held as they are.
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

    def equations(self, T_a_b: Float[Array, "4 4"], level: Level) -> NormalEquations:
        """Normal equations of the tangent (translation [m], rotation [rad]) about the image of the centroid."""
        return pose_equations(self.terms, T_a_b, self.centroid, level)

    def no_equations(self, dtype: jnp.dtype) -> NormalEquations:
        """What is known before the first evaluation: a cost without bound."""
        # Any finite cost is below it, so that the solver keeps its first candidate.
        return NormalEquations(jnp.full((), jnp.inf, dtype), jnp.zeros(6, dtype), jnp.zeros((6, 6), dtype))


def sum_of_squares(rows: object) -> Float[Array, ""]:
    """Sum of the squares of all arrays of a tree."""
    parts = [jnp.sum(row * row, dtype=row.dtype) for row in jax.tree.leaves(rows)]
    return sum(parts[1:], start=parts[0])
