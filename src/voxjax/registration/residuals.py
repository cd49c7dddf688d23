"""Residuals of points of one map against the surface of another, as functions of a small motion.

The motion is a tangent (translation [m], rotation [rad]) about the centroid of map b expressed in frame a, so
that both halves of it are decoupled and float32 keeps its digits.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt32

from .. import rigid
from .._types import Array
from ..ops.lookup import Block, entries, turn_columns, values_at
from ..ops.nearest import NOTHING_NEAR, split_keys
from .losses import Loss, robust_factor

Scalar = Float[Array, ""] | np.floating
"""A length that may be traced."""

SLIDE_WEIGHT = 0.1
"""How much a distance along the surface counts beside one across it: the grid rounds the former."""

FAR_VOXELS = 5.0
"""What a point without a match costs: an offset of so many voxels, the reach of the field."""

MIN_COSINE = 0.5
"""Surfaces whose normals differ by more than 60 degrees do not match."""

MIN_PLANARITY = 0.3
"""Below it a normal says nothing about the side."""


class Surface(NamedTuple):
    """Occupied voxels of map a and the field that finds the nearest of them.

    Attributes:
        keys: Flat field of `ops.nearest.nearest_field`.
        dims: Size of its block [voxel].
        origin: Its outer corner [m].
        voxel_size: [m].
        points: Of the voxels that the keys point to, on the planes there [m].
        normals: Unit normals there.
        planarity: In [0, 1]: how far to trust the normals.
        is_signed: Whether the normals of both maps point to free space, so that two sides of a wall differ.
    """

    keys: UInt32[Array, "flat"]
    dims: Int32[Array, "3"]
    origin: Float32[Array, "3"]
    voxel_size: Float32[Array, ""]
    points: Float32[Array, "m 3"]
    normals: Float32[Array, "m 3"]
    planarity: Float32[Array, "m"]
    is_signed: Bool[Array, ""]


class Sample(NamedTuple):
    """Points of map b and their weights, 0 for padding.

    Attributes:
        points: [m], in frame b.
        normals: Unit normals there; of length 0 where there is no plane.
        weights: At least 0; sum 1.
        centroid: Of map b [m].
    """

    points: Float32[Array, "n 3"]
    normals: Float32[Array, "n 3"]
    weights: Float32[Array, "n"]
    centroid: Float32[Array, "3"]


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


class Meeting(NamedTuple):
    """What the points of b meet under a pose, by columns.

    Attributes:
        gap: Offset from the nearest voxel of a [m].
        normal: Of the surface there.
        planarity: In [0, 1].
        is_match: There is a voxel in reach, and it does not face another way (the other side of a wall, a floor upon a
            ceiling).
    """

    gap: list[Array]
    normal: list[Array]
    planarity: Float[Array, "n"]
    is_match: Bool[Array, "n"]

    def across(self) -> Array:
        """Distance across the surface [m]."""
        return dot(self.gap, self.normal)


def dot(left: Sequence[Array], right: Sequence[Array]) -> Array:
    """Inner products of vectors by columns."""
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def meet(surface: Surface, sample: Sample, T: Float[Array, "4 4"]) -> Meeting:
    """Look up the nearest voxels of a."""
    # By columns: arrays whose last axis is 3 run ten times slower on a CPU.
    moved = [c + T[i, 3] for i, c in enumerate(turn_columns(T, sample.points.T))]
    block = Block(surface.dims, surface.origin, surface.voxel_size)
    cell, is_inside = block.cells_at([(moved[i] - surface.origin[i]) / surface.voxel_size for i in range(3)])
    key = values_at(surface.keys, cell, is_inside, NOTHING_NEAR)
    row = jnp.where(key == NOTHING_NEAR, 0, split_keys(key)[0])
    normal = [entries(column, row) for column in surface.normals.T]
    planarity = entries(surface.planarity, row)
    cosine = dot(normal, turn_columns(T, sample.normals.T))
    cosine = jnp.where(surface.is_signed, cosine, jnp.abs(cosine))
    has_normals = (planarity > MIN_PLANARITY) & jnp.any(sample.normals != 0.0, axis=-1)
    is_match = (key != NOTHING_NEAR) & ~(has_normals & (cosine < MIN_COSINE))
    gap = [moved[i] - entries(column, row) for i, column in enumerate(surface.points.T)]
    return Meeting(gap, normal, planarity, is_match)


def surface_residuals(
    tangent: Float[Array, "6"],
    T: Float[Array, "4 4"],
    surface: Surface,
    sample: Sample,
    scale: Scalar,
    *,
    loss: Loss,
) -> Float[Array, "3 n"]:
    """Weighted robust offsets of the points of b from the surface of a, in units of `scale`.

    Across the surface an offset counts in full, along it by `SLIDE_WEIGHT` (in full where there is no plane).
    A point with nothing in reach counts as one at the end of the field's reach, with no slope.

    Args:
        tangent: Motion after `T`.
        T: `T_a_b`.
        surface: Of map a.
        sample: Of map b.
        scale: Robust scale [m].
        loss: What a large offset costs.
    """
    return pose_residuals(move_about(T, sample.centroid, tangent), surface, sample, scale, loss=loss)


# Jitted: a solver asks for residuals many times while it is traced, and JAX keeps what it has traced.
@partial(jax.jit, static_argnames="loss")
def pose_residuals(
    T: Float[Array, "4 4"], surface: Surface, sample: Sample, scale: Scalar, *, loss: Loss
) -> Float[Array, "3 n"]:
    """`surface_residuals` at a pose."""
    met = meet(surface, sample, T)
    distance = met.across()
    across = [n * distance for n in met.normal]
    slide = SLIDE_WEIGHT * met.planarity + (1.0 - met.planarity)
    offset = [(c + slide * (g - c)) / scale for g, c in zip(met.gap, across, strict=True)]
    far = (surface.voxel_size * FAR_VOXELS / scale, 0.0, 0.0)
    offset = [jnp.where(met.is_match, o, f) for o, f in zip(offset, far, strict=True)]
    factor = robust_factor(dot(offset, offset), loss) * jnp.sqrt(sample.weights)
    return jnp.stack([o * factor for o in offset])


class Backward(NamedTuple):
    """The other way round: points of map a against the surface of map b.

    Attributes:
        surface: Of map b.
        sample: Of map a.
    """

    surface: Surface
    sample: Sample


@partial(jax.jit, static_argnames="loss")
def mutual_residuals(
    T: Float[Array, "4 4"],
    surface: Surface,
    sample: Sample,
    back: Backward | None,
    scale: Scalar,
    *,
    loss: Loss,
) -> Float[Array, "3 n"]:
    """`pose_residuals`, and with `back` those of the inverse pose too, each way with half of the weight."""
    forward = pose_residuals(T, surface, sample, scale, loss=loss)
    if back is None:
        return forward
    backward = pose_residuals(rigid.inverse(T), back.surface, back.sample, scale, loss=loss)
    return jnp.concatenate([forward, backward], axis=1) * np.float32(np.sqrt(0.5))


@partial(jax.jit, static_argnames="loss")
def mean_cost(
    T: Float[Array, "4 4"],
    surface: Surface,
    sample: Sample,
    scale: Scalar,
    *,
    loss: Loss,
    back: Backward | None = None,
) -> Float[Array, ""]:
    """Weighted mean of the robust loss at a pose, in units of the scale squared."""
    residual = mutual_residuals(T, surface, sample, back, scale, loss=loss)
    return jnp.sum(residual * residual, dtype=residual.dtype)


def plane_information(
    T: Float[Array, "4 4"], surface: Surface, sample: Sample, scale: Scalar, back: Backward | None = None
) -> tuple[Float[Array, "6 6"], Float[Array, ""], Float[Array, ""]]:
    """What the planes say about the pose.

    Returns:
        The weighted sum of `J J^T` of the distances across the surface, about the centroid of b in frame a;
        the weighted variance of these distances [m^2]; the sum of the weights that met a plane.
    """
    centre = T[:3, :3] @ sample.centroid + T[:3, 3]
    rows = [_plane_rows(T, surface, sample, scale)]
    points = [rigid.apply(T, sample.points)]
    if back is not None:
        normal, distance, weight = _plane_rows(rigid.inverse(T), back.surface, back.sample, scale)
        # A motion of b moves what a sees in b the other way: the sign falls out of J J^T.
        rows = [(n, d, 0.5 * w) for n, d, w in (rows[0], (normal @ T[:3, :3].T, distance, weight))]
        points.append(back.sample.points)
    normal, distance, weight = (jnp.concatenate(part) for part in zip(*rows, strict=True))
    arm = jnp.concatenate(points) - centre[None, :]
    jacobian = jnp.concatenate([normal, jnp.cross(arm, normal)], axis=1)
    total = jnp.sum(weight, dtype=weight.dtype)
    total_safe = jnp.maximum(total, jnp.finfo(total.dtype).tiny)
    variance = jnp.sum(weight * distance * distance, dtype=weight.dtype) / total_safe
    return (jacobian * weight[:, None]).T @ jacobian, variance, total


def _plane_rows(
    T: Float[Array, "4 4"], surface: Surface, sample: Sample, scale: Scalar
) -> tuple[Float[Array, "n 3"], Float[Array, "n"], Float[Array, "n"]]:
    """Normals in the frame of the surface, distances across it and robust weights."""
    met = meet(surface, sample, T)
    squared = dot(met.gap, met.gap) / (scale * scale)
    weight = jnp.where(met.is_match, sample.weights * met.planarity / (1.0 + squared) ** 2, 0.0)
    return jnp.stack(met.normal, axis=-1), met.across(), weight
