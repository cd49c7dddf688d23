"""Surface moments at listed voxels: normal, curvature and the side on which space is free.

Work grows with the number of listed voxels, not with the volume.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from .._buckets import flat_block
from .._checks import check_odd_window
from .._types import FREE, OCCUPIED, Array
from .eigen import symmetric_eigen

_CHUNK = 4096


class SurfaceMoments(NamedTuple):
    """What the neighbourhood of each listed voxel says about the surface there.

    Attributes:
        normal: float32 (n, 3) unit vectors, toward the free neighbours where there are any.
        curvature: float32 (n,): smallest eigenvalue of the covariance over the sum of all, 0 (plane) to 1/3.
        num_occupied: int32 (n,): occupied voxels in the window, the centre included.
        has_free: bool (n,): whether the window holds free voxels off the plane, so that the sign means
            something.
        offset: float32 (n,) [voxel]: from the voxel's centre along the normal to the plane through the mean of the
            occupied voxels in the window.
        free_distance: uint8 (n, 2) [voxel]: steps along +normal and along -normal to the first free voxel,
            where nothing unknown comes before; `reach + 1` where there is none.
    """

    normal: Float32[Array, "n 3"]
    curvature: Float32[Array, "n"]
    num_occupied: Int32[Array, "n"]
    has_free: Bool[Array, "n"]
    offset: Float32[Array, "n"]
    free_distance: UInt8[Array, "n 2"]


def ball_offsets(size: int) -> np.ndarray:
    """Voxel offsets int32 (k, 3) within size / 2 of the centre: a ball treats all directions alike."""
    half = size // 2
    axis = np.arange(-half, half + 1)
    offsets = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return offsets[(offsets**2).sum(axis=1) <= (size / 2) ** 2].astype(np.int32)


def surface_moments(
    states: UInt8[Array, "x y z"], index: Int32[Array, "n 3"], *, size: int = 7, reach: int = 3
) -> SurfaceMoments:
    """Normal, curvature and free sides of the surface at listed voxels (section III, reference 12).

    The normal is the eigenvector of the smallest eigenvalue of the covariance of the occupied voxels in a ball of
    diameter `size`, and points toward the mean offset of the free voxels in it. Host arrays are padded to a rung of
    the ladder of sizes, so that maps of other shapes compile nothing.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        index: Voxels to look at, inside the grid; rows may repeat (padding).
        size: Diameter of the window [voxel]; odd.
        reach: How many steps to look for free space along the normal [voxel].

    Returns:
        `SurfaceMoments`, rows as in `index`. Fewer than three voxels, or voxels on a line, leave a normal that is
        some unit vector; `curvature` is then 0 and `num_occupied` small.
    """
    margin = max(check_odd_window("size", size) // 2, reach)
    if isinstance(states, np.ndarray):
        padded = np.pad(states, margin)
        flat = flat_block(padded)
    else:
        padded = jnp.pad(states, margin)
        flat = padded.reshape(-1)
    return _flat_moments(
        flat, np.asarray(padded.shape, np.int32), index, size=size, reach=reach, margin=margin
    )


@partial(jax.jit, static_argnames=("size", "reach", "margin"))
def _flat_moments(
    flat: UInt8[Array, "flat"], dims: Int32[Array, "3"], index: Int32[Array, "n 3"],
    *, size: int, reach: int, margin: int,
) -> SurfaceMoments:  # fmt: skip
    """`surface_moments` on a flat block that is `margin` voxels wider on each side than the grid of `index`."""
    offsets = ball_offsets(size)
    strides = jnp.stack([dims[1] * dims[2], dims[2], jnp.ones_like(dims[2])])
    steps = jnp.sum(jnp.asarray(offsets) * strides[None, :], axis=1, dtype=jnp.int32)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    columns = [np.ones(len(offsets)), *offsets.T, *(offsets[:, i] * offsets[:, j] for i, j in pairs)]
    basis = jnp.asarray(np.stack(columns, axis=1), jnp.float32)

    def one_chunk(rows: Array) -> SurfaceMoments:
        base = jnp.sum((rows + margin) * strides[None, :], axis=1, dtype=jnp.int32)
        window = flat[base[:, None] + steps[None, :]]
        # Sums of small whole numbers: exact in float32.
        sums = (window == OCCUPIED).astype(jnp.float32) @ basis
        free = (window == FREE).astype(jnp.float32) @ basis[:, :4]
        return _summarise(flat, base, strides, sums, free, reach)

    num_chunks = -(-index.shape[0] // _CHUNK)
    rows = jnp.pad(index, ((0, num_chunks * _CHUNK - index.shape[0]), (0, 0)))
    out = jax.lax.map(one_chunk, rows.reshape(num_chunks, _CHUNK, 3))
    return SurfaceMoments(*(a.reshape(-1, *a.shape[2:])[: index.shape[0]] for a in out))


def _summarise(
    flat: Array, base: Array, strides: Array, sums: Array, free: Array, reach: int
) -> SurfaceMoments:
    """Moments of one chunk to normals, curvature and free sides."""
    count = jnp.maximum(sums[:, :1], 1.0)
    mean = sums[:, 1:4] / count
    second = sums[:, 4:] / count
    xx, yy, zz, xy, xz, yz = (second[:, k] for k in range(6))
    full = jnp.stack(
        [jnp.stack([xx, xy, xz], -1), jnp.stack([xy, yy, yz], -1), jnp.stack([xz, yz, zz], -1)], -2
    )
    values, vectors = symmetric_eigen(full - mean[:, :, None] * mean[:, None, :])
    values = jnp.maximum(values, 0.0)
    normal = vectors[:, 0]
    # The free voxels' offset from the surface, along the normal.
    lean = jnp.sum((free[:, 1:4] - free[:, :1] * mean) * normal, axis=1, dtype=jnp.float32)
    normal = jnp.where((lean < 0.0)[:, None], -normal, normal)
    total = jnp.sum(values, axis=1, dtype=jnp.float32)
    curvature = values[:, 0] / jnp.where(total > 0.0, total, jnp.ones_like(total))
    distance = jnp.stack(
        [_steps_to_free(flat, base, strides, s * normal, reach) for s in (1.0, -1.0)], axis=1
    )
    offset = jnp.sum(mean * normal, axis=1, dtype=jnp.float32)
    return SurfaceMoments(
        normal, curvature, sums[:, 0].astype(jnp.int32), jnp.abs(lean) > 0.5, offset, distance
    )


def _steps_to_free(flat: Array, base: Array, strides: Array, direction: Array, reach: int) -> Array:
    """Steps to the first free voxel along a direction before anything unknown; reach + 1 if none."""
    distance = jnp.full(base.shape, reach + 1, jnp.uint8)
    is_open = jnp.ones(base.shape, jnp.bool_)
    for step in range(1, reach + 1):
        # Scaled so that each step enters a new voxel along the direction's largest axis.
        largest = jnp.max(jnp.abs(direction), axis=1, keepdims=True)
        move = jnp.round(step * direction / largest).astype(jnp.int32)
        state = flat[base + jnp.sum(move * strides[None, :], axis=1, dtype=jnp.int32)]
        distance = jnp.where(is_open & (state == FREE), jnp.uint8(step), distance)
        is_open = is_open & (state == OCCUPIED)
    return distance
