"""What every kind of residual has in common: rows under a pose, at a level, robust and weighted."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar
from jax.core import Tracer
from jaxtyping import Float, Int32, PyTree

from ... import rigid
from ..._checks import InputError, check_list, check_type
from ..._types import Array
from ...ops.evidence.lookup import turn_columns
from .losses import Loss, robust_factor

Columns = Sequence[Float[Array, "n"]]
"""Points or vectors as x, y and z: arrays whose last axis is 3 leave most lanes of a CPU empty."""


class Level(NamedTuple):
    """One step of coarse to fine.

    Attributes:
        scale: Robust scale: offsets well beyond it hardly count [m].
        number: 0 is the coarsest.
    """

    scale: Float[Array, ""]
    number: Int32[Array, ""]


class Term(eqx.Module):
    """Residuals of one kind; the solver minimises the sum of squares of the rows of all terms.

    A new kind is a subclass with arrays as fields and `rows`; everything is differentiable in the fields that are
    floating. Residuals of points that are moved are quicker as a `PointTerm`; those that look for a partner have `met`
    and `holding` too.
    """

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, "k n"]:
        """Residuals under a pose: k numbers for each of n points, robust, weighted, without a unit."""
        raise NotImplementedError

    def met(self, T_a_b: Float[Array, "4 4"]) -> PyTree:
        """What the points meet under a pose, where that jumps with the pose; None for continuous terms."""
        del T_a_b

    def holding(self, met: PyTree) -> "Term":
        """The term with what its points meet held: smooth in the pose.

        Args:
            met: What `met` gave, not None.
        """
        raise NotImplementedError

    def thinned(self, stride: int) -> "Term":
        """The term with every `stride`-th point, which weighs as much as all; for the coarse levels."""
        del stride
        return self


def check_terms(name: str, terms: object) -> tuple[Term, ...]:
    """Return terms as a tuple.

    Raises:
        InputError: If `terms` is no list, such as one term alone, holds something else, or a term with NaN.
    """
    checked = check_list(name, terms, "terms")
    for number, term in enumerate(checked):
        check_type(f"{name}[{number}]", term, Term, "make it from voxjax.refinement")
        for path, leaf in jax.tree_util.tree_leaves_with_path(term):
            if _has_nan(leaf):
                where = f"{name}[{number}]{jax.tree_util.keystr(path)}"
                raise InputError(
                    f"{where} must hold numbers, but some are NaN; leave those rows, or that term, out."
                )
    return tuple(checked)


def _has_nan(leaf: object) -> bool:
    """Whether a part of a term holds NaN, whose cost compares as no worse than any other."""
    # What is traced has no values yet.
    if isinstance(leaf, Tracer):
        return False
    values = np.asarray(leaf)
    return jnp.issubdtype(values.dtype, jnp.inexact) and bool(np.isnan(values).any())


class Placed(NamedTuple):
    """Points under a pose.

    Attributes:
        points: Where they are in the map that they are held against [m].
        shift: (3, 3): column j is how they move there when map b is shifted along axis j of frame a.
        arm: Where they are in frame a, from the point about which map b is turned [m].
    """

    points: Columns
    shift: Float[Array, "3 3"]
    arm: Columns


class PointTerm(Term):
    """Residuals of points: offsets of each point depend on its place and on nothing else of the pose.

    Attributes:
        loss: What a large offset costs.
        is_inverse: Whether the points are map a's, moved by the inverse pose and held against map b.
    """

    loss: AbstractVar[Loss]
    is_inverse: AbstractVar[bool]

    def points(self) -> Float[Array, "n 3"]:
        """The points, in the frame of their own map [m]."""
        raise NotImplementedError

    def weights(self) -> Float[Array, "n"]:
        """Weights of the points, at least 0."""
        raise NotImplementedError

    def offsets(self, points: Columns, level: Level) -> Columns:
        """Offsets of points that have been moved, in units of the robust scale, by columns."""
        raise NotImplementedError

    def placed(self, T_a_b: Float[Array, "4 4"], pivot: Float[Array, "3"]) -> Placed:
        """The points under a pose; `pivot` is where map b is turned about, in frame a [m]."""
        points = self.points()
        if self.is_inverse:
            T = rigid.inverse(T_a_b)
            arm = [column - pivot[i] for i, column in enumerate(points.T)]
            # Seen from b, a motion of b along axis j of frame a moves the points the other way, turned into frame b.
            return Placed(moved_columns(T, points), -T[:3, :3], arm)
        moved = moved_columns(T_a_b, points)
        shift = jnp.eye(3, dtype=T_a_b.dtype)
        return Placed(moved, shift, [column - pivot[i] for i, column in enumerate(moved)])

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, "k n"]:
        """See `Term`."""
        # Only derivatives need the arms, so that any pivot serves here.
        placed = self.placed(T_a_b, jnp.zeros(3, T_a_b.dtype))
        return robust_rows(self.offsets(placed.points, level), self.weights(), self.loss)


def moved_columns(T: Float[Array, "4 4"], points: Float[Array, "n 3"]) -> list[Array]:
    """Points under a pose, by columns."""
    return [column + T[i, 3] for i, column in enumerate(turn_columns(T, points.T))]


def dot(left: Columns, right: Columns) -> Float[Array, "n"]:
    """Inner products of vectors by columns."""
    products = [a * b for a, b in zip(left, right, strict=True)]
    return sum(products[1:], start=products[0])


def robust_rows(offset: Columns, weights: Float[Array, "n"], loss: Loss) -> Float[Array, "k n"]:
    """Offsets in units of the robust scale, shrunk so that the sum of their squares is the robust loss.

    Args:
        offset: Offsets of the points, by columns.
        weights: Weights of the points, at least 0.
        loss: What a large offset costs.
    """
    # All offsets of a point share one factor: the loss is that of its distance, not of each coordinate.
    squared = dot(offset, offset)
    return jnp.stack(list(offset)) * (robust_factor(squared, loss) * root_of_weights(weights))[None, :]


def root_of_weights(weights: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Square root of weights that may be 0; products with rows keep their true derivative there.

    The cost of a point is its weight times a loss, whose derivative with respect to the weight is the loss, but the
    root alone has an infinite slope at 0.
    """
    # Far below any weight, far above what float32 can hold.
    least_weight = 1e-20
    return jnp.sqrt(weights + jnp.asarray(least_weight, weights.dtype))
