"""Whole-grid resampling kernels for use under jit, vmap and grad: nearest voxel, or linear between centres."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32, Shaped

from .._types import Array

TIE = 1e-3
"""Centres on the border of two source voxels go to the upper one, whichever way float32 rounded [voxel]."""


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
        source_voxel_size: Of the source [m].
        target_origin: Outer corner of the target [m].
        target_voxel_size: Of the target [m].
    """
    inverse = jnp.swapaxes(jnp.asarray(T)[:3, :3], 0, 1)
    corner = jnp.asarray(target_origin) - T[:3, 3]
    offset = (
        jnp.sum(inverse * corner[None, :], axis=1, dtype=inverse.dtype) - source_origin
    ) / source_voxel_size
    return jnp.concatenate([inverse * (target_voxel_size / source_voxel_size), offset[:, None]], axis=1)


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
    coordinates = _centres(affine, target_shape)
    index = jnp.floor(coordinates + jnp.asarray(TIE, coordinates.dtype)).astype(jnp.int32)
    is_inside = is_inside_grid(index, jnp.asarray(values.shape, jnp.int32))
    x, y, z = (jnp.clip(index[..., a], 0, values.shape[a] - 1) for a in range(3))
    return jnp.where(is_inside, jnp.asarray(values)[x, y, z], jnp.zeros((), values.dtype))


@functools.partial(jax.jit, static_argnames=("target_shape",))
def resample_trilinear(
    values: Float[Array, "x y z"],
    affine: Float[Array, "3 4"],
    *,
    target_shape: tuple[int, int, int],
) -> Float[Array, "u v w"]:
    """Values at the centres of the target voxels, linear between the source's centres; 0 outside the source.

    Differentiable in `values`, and in the pose wherever a centre does not cross from one cell to the next.

    Args:
        values: Source grid, such as log-odds.
        affine: From target to source voxels, see `backward_affine`.
        target_shape: Static.

    Returns:
        Same dtype as `values`.
    """
    coordinates = _centres(affine, target_shape).astype(values.dtype) - jnp.asarray(0.5, values.dtype)
    low = jnp.floor(coordinates)
    weight_high = coordinates - low
    low = low.astype(jnp.int32)
    shape = jnp.asarray(values.shape, jnp.int32)
    total = jnp.zeros(target_shape, values.dtype)
    for corner in np.ndindex(2, 2, 2):
        index = low + jnp.asarray(corner, jnp.int32).reshape(1, 1, 1, 3)
        is_high = jnp.asarray(corner, bool).reshape(1, 1, 1, 3)
        weight = jnp.prod(jnp.where(is_high, weight_high, 1 - weight_high), axis=-1)
        x, y, z = (jnp.clip(index[..., a], 0, values.shape[a] - 1) for a in range(3))
        found = jnp.where(
            is_inside_grid(index, shape), jnp.asarray(values)[x, y, z], jnp.zeros((), values.dtype)
        )
        total = total + weight * found
    return total


def is_inside_grid(index: Int32[Array, "*n 3"], shape: Int32[Array, "3"]) -> Bool[Array, "*n"]:
    """Whether voxel indices lie inside a grid of that shape."""
    shape = jnp.asarray(shape).reshape((1,) * (index.ndim - 1) + (3,))
    return jnp.all((index >= 0) & (index < shape), axis=-1)


def _centres(affine: Array, target_shape: tuple[int, int, int]) -> Array:
    """Source coordinates of the centres of all target voxels, (u, v, w, 3)."""
    matrix = jnp.asarray(affine)
    x, y, z = (jnp.arange(side, dtype=matrix.dtype) + jnp.asarray(0.5, matrix.dtype) for side in target_shape)
    along = x[:, None, None, None] * matrix[:, 0].reshape(1, 1, 1, 3)
    along = along + y[None, :, None, None] * matrix[:, 1].reshape(1, 1, 1, 3)
    along = along + z[None, None, :, None] * matrix[:, 2].reshape(1, 1, 1, 3)
    return along + matrix[:, 3].reshape(1, 1, 1, 3)
