"""Residuals of known partners: corners that were matched, and a pose that is believed beforehand."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from ... import rigid
from ..._types import Array
from .losses import Loss
from .terms import Columns, Level, PointTerm, Term


class CornerPairs(PointTerm):
    """Matched points of both maps: corner to corner.

    Attributes:
        of_a: Points of map a [m].
        of_b: The partners of those points in map b [m].
        share: Weight of each pair, at least 0.
        loss: What a large offset costs.
    """

    of_a: Float[Array, "n 3"]
    of_b: Float[Array, "n 3"]
    share: Float[Array, "n"]
    loss: Loss = eqx.field(static=True, default="geman_mcclure")
    is_inverse: bool = eqx.field(static=True, default=False)

    def points(self) -> Float[Array, "n 3"]:
        """See `PointTerm`."""
        return self.of_b

    def weights(self) -> Float[Array, "n"]:
        """See `PointTerm`."""
        return self.share

    def offsets(self, points: Columns, level: Level) -> Columns:
        """See `PointTerm`."""
        # Partners are known: nothing is looked up, and the offset counts in full in every direction.
        return [(p - q) / level.scale for p, q in zip(points, self.of_a.T, strict=True)]


class Prior(Term):
    """A pose that is believed beforehand: the solution then depends on it, and has a derivative with respect to it.

    Attributes:
        T_a_b: The pose that is believed.
        centroid: Centroid of map b [m].
        root_information: W, where `W^T W` is the inverse covariance of the tangent (translation [m], rotation [rad])
            about the image of the centroid, in units in which the other terms' costs are counted.
    """

    T_a_b: Float[Array, "4 4"]
    centroid: Float[Array, "3"]
    root_information: Float[Array, "6 6"]

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, "6 1"]:
        """See `Term`."""
        del level
        # A belief has its own scale, whatever level the others are at.
        # The squares of the rows add up to the squared Mahalanobis distance from the belief.
        return (self.root_information @ tangent_between(self.T_a_b, T_a_b, self.centroid))[:, None]


def tangent_between(
    T: Float[Array, "4 4"], other: Float[Array, "4 4"], centroid: Float[Array, "3"]
) -> Float[Array, "6"]:
    """The motion about the image of `centroid` that leads from one pose to another; undoes `move_about`."""
    # Shifts are those of the centroid's image, so that a turn alone has none.
    shift = other[:3, :3] @ centroid + other[:3, 3] - T[:3, :3] @ centroid - T[:3, 3]
    return jnp.concatenate([shift, rigid.log_so3(other[:3, :3] @ T[:3, :3].T)])
