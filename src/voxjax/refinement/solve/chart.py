"""Poses around a start as unknowns of a solver: one pose, or those of many maps."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ..._types import Array
from .equations import move_about, tangent_slopes


class Chart(NamedTuple):
    """Poses as six unknowns each around a start, in units in which their steps are of order one.

    Attributes:
        start: The poses at which all unknowns are 0.
        centroid: Points about which the poses turn, in the frames of the maps that are moved [m].
        units: Size of one unit of each unknown [m, rad].
        is_fixed: Poses that stay; None where none does.
    """

    start: Float[Array, "*maps 4 4"]
    centroid: Float[Array, "*maps 3"]
    units: Float[Array, "*maps 6"]
    is_fixed: Bool[Array, "*maps"] | None = None

    def poses(self, unknowns: Float[Array, "*maps 6"]) -> Float[Array, "*maps 4 4"]:
        """The poses that unknowns stand for."""
        moved = self._each(move_about)(self.start, self.centroid, unknowns * self.units)
        return (
            # Poses that stay are taken from the start, because a motion of 0 would still round them.
            moved if self.is_fixed is None else jnp.where(self.is_fixed[..., None, None], self.start, moved)
        )

    def slopes(self, unknowns: Float[Array, "*maps 6"]) -> Float[Array, "*maps 6 6"]:
        """Tangents about the images of the centroids with a change of the unknowns; 0 for poses that stay."""
        # Normal equations are those of a tangent at the pose itself, unknowns count from the start: by the chain rule
        # this turns the former into equations of the latter, without a derivative of the residuals through the chart.
        slopes = self._each(tangent_slopes)(unknowns * self.units) * self.units[..., None, :]
        if self.is_fixed is None:
            return slopes
        return jnp.where(self.is_fixed[..., None, None], jnp.zeros_like(slopes), slopes)

    def _each(self, function: Callable[..., Array]) -> Callable[..., Array]:
        """A function of one pose as a function of as many as the chart has."""
        return function if self.start.ndim == 2 else jax.vmap(function)


def chart_about(
    start: Float[Array, "*maps 4 4"],
    centroid: Float[Array, "*maps 3"],
    radius: Float[Array, "*maps"],
    scale: Float[Array, ""],
    *,
    is_fixed: Bool[Array, "*maps"] | None = None,
) -> Chart:
    """The chart in which a unit moves points at the radius by about one robust scale, by shift or by turn.

    Args:
        start: The poses at which all unknowns are 0.
        centroid: Centroids of the maps that are moved [m].
        radius: Lengths that make radians comparable to metres: about those of the maps [m].
        scale: Robust scale of the level that is solved in the chart [m].
        is_fixed: Poses that stay; None where none does.
    """
    one = jnp.ones((*start.shape[:-2], 3), start.dtype)
    # A turn by one scale over the radius moves points at the radius by one scale.
    units = jnp.concatenate([one, one / jnp.asarray(radius)[..., None]], axis=-1) * scale
    return Chart(start, centroid, units, is_fixed)
