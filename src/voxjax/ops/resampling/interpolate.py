"""Whole-grid resampling kernels for use under jit, vmap and grad: nearest voxel, or linear between centres."""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32, Shaped

from ..._runtime.forks import refused_after_fork
from ..._types import Array

TIE = 1e-3
"""Centres on the border of two source voxels go to the upper one, whichever way float32 rounded [voxel]."""


@refused_after_fork
def backward_affine(
    T: Float[Array, "4 4"],
    source_origin: Float[Array, "3"],
    source_voxel_size: float,
    target_origin: Float[Array, "3"],
    target_voxel_size: float,
) -> Float[Array, "3 4"]:
    """Affine map from coordinates of target voxels to those of source voxels, for a source moved by `T`.

    Both count voxels from the outer corner of their grid, so the first centre is at 0.5. Differentiable in
    the pose and the origins; computed in their precision.

    Args:
        T: Pose that moves the source.
        source_origin: Outer corner of the source [m].
        source_voxel_size: Width of the source's voxels [m].
        target_origin: Outer corner of the target [m].
        target_voxel_size: Width of the target's voxels [m].
    """
    # A rotation is inverted by transposing it: exact, and no linear solve has to be differentiated.
    inverse = jnp.swapaxes(jnp.asarray(T)[:3, :3], 0, 1)
    corner = jnp.asarray(target_origin) - T[:3, 3]
    # The product is written as a sum: as one of matrices it may run in a lower precision on some devices.
    offset = (
        jnp.sum(inverse * corner[None, :], axis=1, dtype=inverse.dtype) - source_origin
    ) / source_voxel_size
    return jnp.concatenate([inverse * (target_voxel_size / source_voxel_size), offset[:, None]], axis=1)


@refused_after_fork
@functools.partial(jax.jit, static_argnames=("target_shape",))
def resample_nearest(
    values: Shaped[Array, "x y z"],
    affine: Float[Array, "3 4"],
    *,
    target_shape: tuple[int, int, int],
) -> Shaped[Array, "u v w"]:
    """Values of the source voxels that hold the centres of the target voxels; 0 outside the source.

    Args:
        values: Source grid, any dtype.
        affine: From target to source voxels, see `backward_affine`.
        target_shape: Static.

    Returns:
        Same dtype as `values`.
    """
    # A source without voxels has none that places could be clipped to.
    if 0 in values.shape:
        return jnp.zeros(target_shape, values.dtype)
    tie = jnp.asarray(TIE, jnp.asarray(affine).dtype)
    index = [jnp.floor(centre + tie).astype(jnp.int32) for centre in _centres(affine, target_shape)]
    # Clipped, so that the lookup need check no bounds; what was outside becomes 0 afterwards.
    place = [jnp.clip(i, 0, side - 1) for i, side in zip(index, values.shape, strict=True)]
    inside = [is_within(i, side) for i, side in zip(index, values.shape, strict=True)]
    return _take(values, place, inside)


@refused_after_fork
@functools.partial(jax.jit, static_argnames=("target_shape",))
def resample_trilinear(
    values: Float[Array, "x y z"],
    affine: Float[Array, "3 4"],
    *,
    target_shape: tuple[int, int, int],
) -> Float[Array, "u v w"]:
    """Values at the centres of the target voxels, linear between the source's centres; 0 outside the source.

    Differentiable in `values`, and in the pose wherever a centre does not cross from one cell to the next. No
    temporary memory on a CPU; a gradient takes about 100 bytes per target voxel.

    Args:
        values: Source grid, such as log-odds.
        affine: From target to source voxels, see `backward_affine`.
        target_shape: Static.

    Returns:
        Same dtype as `values`.
    """
    if 0 in values.shape:
        return jnp.zeros(target_shape, values.dtype)
    weights, places, insides = [], [], []
    for centre, side in zip(_centres(affine, target_shape), values.shape, strict=True):
        # Weights multiply values, so they have the dtype of values: strict promotion mixes none.
        from_centre = centre.astype(values.dtype) - jnp.asarray(0.5, values.dtype)
        low = jnp.floor(from_centre)
        weight_high = from_centre - low
        # A centre within half a voxel of the border has one end outside, which counts as 0.
        ends = low.astype(jnp.int32), low.astype(jnp.int32) + 1
        weights.append((1 - weight_high, weight_high))
        places.append([jnp.clip(end, 0, side - 1) for end in ends])
        insides.append([is_within(end, side) for end in ends])
    # Term by term, which XLA fuses into one loop: no array of eight values a voxel is made.
    total = jnp.zeros(target_shape, values.dtype)
    for corner in np.ndindex(2, 2, 2):
        weight, place, inside = (
            [of_axis[end] for of_axis, end in zip(axes, corner, strict=True)]
            for axes in (weights, places, insides)
        )
        total = total + weight[0] * weight[1] * weight[2] * _take(values, place, inside)
    return total


def is_within(index: Int32[Array, "*n"], side: Int32[Array, ""] | int) -> Bool[Array, "*n"]:
    """Whether indices along one axis lie inside a grid that has `side` voxels there."""
    return (index >= 0) & (index < side)


def _centres(affine: Array, target_shape: tuple[int, int, int]) -> list[jax.Array]:
    """Source coordinates x, y, z of the centres of all target voxels, an array (u, v, w) each.

    One array for each: XLA does not vectorise over arrays whose last axis is 3 (CPU).
    """
    matrix = jnp.asarray(affine)
    u, v, w = (jnp.arange(side, dtype=matrix.dtype) + jnp.asarray(0.5, matrix.dtype) for side in target_shape)
    return [
        (u * row[0])[:, None, None] + (v * row[1])[None, :, None] + (w * row[2])[None, None, :] + row[3]
        for row in matrix
    ]


def _take(values: Array, place: Sequence[Array], inside: Sequence[Array]) -> jax.Array:
    """Values at places x, y, z, all of them inside the grid; 0 unless `inside` holds for each of the three."""
    x, y, z = place
    found = jnp.asarray(values).at[x, y, z].get(mode="promise_in_bounds")
    return jnp.where(inside[0] & inside[1] & inside[2], found, jnp.zeros((), values.dtype))
