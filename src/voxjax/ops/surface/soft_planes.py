"""Planes fitted around voxels that are occupied with a probability, differentiable in the probabilities.

Where all of them are 1 these are the planes of `moments.surface_moments`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from ..._checks import InputError
from ..._runtime.precision import in_full_precision
from ..._types import Array
from ..eigen import eigen_by_columns
from .axes import TIED
from .neighbourhood import Neighbourhood, ball_sums


class SoftPlanes(NamedTuple):
    """The plane through the neighbourhood of each voxel, dtype of the occupancy.

    Attributes:
        normal: (m, 3) unit vectors.
        offset: (m,) [voxel]: from the voxel's centre along the normal to the plane through the weighted mean.
        planarity: (m,) in [0, 1]: 1 on a plane, 0 from half the curvature of a ball on, and where the occupancies add
            up to 9 or less; between 9 and 10 it rises smoothly, with no slope at whole numbers.
        weight: (m,): sum of the occupancies in the window, the voxel's own included.
    """

    normal: Float[Array, "m 3"]
    offset: Float[Array, "m"]
    planarity: Float[Array, "m"]
    weight: Float[Array, "m"]


@jax.jit
@in_full_precision
def soft_planes(
    occupancy: Float[Array, "m"], toward: Float[Array, "m 3"], neighbours: Neighbourhood
) -> SoftPlanes:
    """Fit a plane around each listed voxel to its neighbours, each weighing as much as it is probably occupied.

    The normal is the eigenvector of the smallest eigenvalue of the weighted covariance, turned toward a given
    direction. Where the smallest eigenvalues tie (posts, lines, lone voxels), all normals across fit equally well, and
    the one nearest to the given direction is taken. Differentiable in the occupancy in both modes; what
    has no derivative, as the turn between tied axes, is left out, so that gradients are finite everywhere.

    Args:
        occupancy: Probability in [0, 1] of each voxel of the list that the neighbourhood was built of, in its order;
            may be padded. Voxels that are not listed count as empty.
        toward: Direction that signs the normals; any length, 0 for none. Not differentiated.
        neighbours: Neighbours in the list, see `neighbourhood`.

    Returns:
        `SoftPlanes`, a row for each occupancy. Without occupied voxels around, the planarity, weight and offset are 0
        and the normal is some unit vector.

    Raises:
        InputError: If there are more occupancies than the neighbourhood has rows, or not as many directions.
    """
    # Times the curvature of a plane that is none: half the curvature of a ball.
    no_plane = 6.0
    # Occupied voxels that define a normal: a line through the window has 7.
    enough_voxels = 10
    # Sum of occupancies from which on a window has a mean and a covariance.
    least_weight = 1e-6
    occupancy = jnp.asarray(occupancy)
    if occupancy.shape[0] > neighbours.place.shape[0] or toward.shape[0] != occupancy.shape[0]:
        raise InputError(
            f"occupancy and toward must have the same number of rows, at most the {neighbours.place.shape[0]} of the "
            f"neighbourhood, got {occupancy.shape[0]} and {toward.shape[0]}."
        )
    directions = tuple(jax.lax.stop_gradient(jnp.asarray(toward)).astype(occupancy.dtype).T)
    weight, *sums = ball_sums(occupancy, neighbours)
    first, second = sums[:3], sums[3:]
    is_there = weight > least_weight
    # Guarded on both sides: derivatives of the branch that is not taken would be NaN.
    share = jnp.where(is_there, 1 / jnp.where(is_there, weight, 1), 0)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    # Products before the division: of whole numbers they are exact, and nothing cancels.
    covariance = [
        (weight * second[k] - first[i] * first[j]) * (share * share) for k, (i, j) in enumerate(pairs)
    ]
    eigen = eigen_by_columns(jnp.stack(covariance), tolerance=TIED)
    low, middle, high = (jnp.maximum(value, 0) for value in eigen.values)
    total = low + middle + high
    curvature = low / jnp.where(total > 0, total, 1)

    # The axis of least variance, signed by the given direction; across posts and lines, the nearest to that direction.
    chosen = _across(directions, eigen.vectors[2], eigen.is_defined[2])
    axis = tuple(jnp.where(eigen.is_defined[0], a, c) for a, c in zip(eigen.vectors[0], chosen, strict=True))
    is_turned = _dot(directions, axis) < 0
    normal = tuple(jnp.where(is_turned, -a, a) for a in axis)
    # Between 9 and 10 a cubic rises with no slope at its ends: whole numbers of voxels, as in a map, give no gradient.
    enough = jnp.clip(weight - (enough_voxels - 1), 0, 1)
    return SoftPlanes(
        jnp.stack(normal, axis=1),
        _dot(tuple(s * share for s in first), normal),
        jnp.maximum(1 - no_plane * curvature, 0) * enough * enough * (3 - 2 * enough),
        weight,
    )


def _across(directions: tuple, line: Array, is_line: Array) -> tuple:
    """The unit vector nearest to a direction, across a line where there is one; nearest to an axis if that is none."""
    # Squared length below which what is left of a direction across a line says nothing.
    short = 1e-12
    # Lines closer to x than this cosine get a normal toward y, other lines one toward x.
    along_x = 0.75

    def across(direction: tuple) -> tuple:
        along = jnp.where(is_line, _dot(direction, tuple(line)), 0)
        return tuple(d - along * h for d, h in zip(direction, line, strict=True))

    is_along_x = is_line & (jnp.abs(line[0]) > along_x)
    x = (~is_along_x).astype(line.dtype)
    told = across(directions)
    is_told = _dot(told, told) > short
    # The axis that is taken lies well off the line, so that what is left of it is never short.
    vector = tuple(
        jnp.where(is_told, t, a) for t, a in zip(told, across((x, 1 - x, jnp.zeros_like(x))), strict=True)
    )
    inverse = jax.lax.rsqrt(_dot(vector, vector))
    return tuple(v * inverse for v in vector)


def _dot(a: tuple, b: tuple) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
