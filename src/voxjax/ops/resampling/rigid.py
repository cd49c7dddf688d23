"""Rigid resampling of grids by backward lookup: each target voxel asks where its centre came from.

Forward moves would leave holes; backward lookup cannot. `lookup_chunk` works in pieces of one shape, so that
maps of any size share a few compiled programs and memory stays bounded. For whole grids under jit, vmap and
grad see `interpolate`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Shaped, UInt8

from ..._runtime.buckets import bucket_size
from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory
from ..._types import Array
from ...frames import snapped, to_local
from .interpolate import TIE, is_within
from .lattice import (
    about_middle,
    cell_of_image,
    check_num_voxels,
    moved_bounds,
    origin_in_voxels,
    origin_of_cell,
)


def source_from_target(
    T: Float[np.ndarray, "4 4"],
    source_origin: Float[np.ndarray, "3"],
    source_voxel_size: float,
    target_cell: Shaped[np.ndarray, "3"],
    target_voxel_size: float,
) -> Float32[np.ndarray, "3 4"]:
    """Affine map from coordinates of target voxels to those of source voxels, for a source moved by `T`.

    Both count voxels from the outer corner of their grid. Computed in float64, and small numbers by the time they are
    rounded to float32.
    """
    matrix = np.asarray(T, np.float64)
    inverse = matrix[:3, :3].T
    scale = target_voxel_size / source_voxel_size
    corner = np.asarray(target_cell, np.float64) * target_voxel_size - matrix[:3, 3]
    offset = inverse @ corner / source_voxel_size - origin_in_voxels(source_origin, source_voxel_size)
    return np.concatenate([inverse * scale, offset[:, None]], axis=1).astype(np.float32)


@functools.partial(jax.jit, static_argnames=("size",))
def lookup_chunk(
    source_shape: Int32[Array, "3"],
    source_from_target: Float32[Array, "3 4"],
    target_shape: Int32[Array, "3"],
    start: Int32[Array, ""],
    *,
    size: int,
) -> tuple[Int32[Array, " size"], Bool[Array, " size"]]:
    """Flat source index of the nearest voxel for a run of flat target indices, and whether there is one.

    Args:
        source_shape: Traced, so that sources of all shapes share one program.
        source_from_target: Affine map (3, 4) that the function of that name gives.
        target_shape: Traced.
        start: First flat target index.
        size: Length of the run, static.
    """
    # The last run is longer than what is left of the target: its surplus looks up the last voxel, and is cut off later.
    flat = jnp.minimum(start + jnp.arange(size, dtype=jnp.int32), jnp.prod(target_shape, dtype=jnp.int32) - 1)
    # No numbers are negative: `//` and `%` would look after signs, at three times the price.
    row = jax.lax.div(flat, jnp.full_like(flat, target_shape[2]))
    x = jax.lax.div(row, jnp.full_like(row, target_shape[1]))
    y, z = row - x * target_shape[1], flat - row * target_shape[2]
    centre = [axis.astype(jnp.float32) + jnp.float32(0.5) for axis in (x, y, z)]
    m = source_from_target
    # Written out by rows: a matrix product may run in a lower precision on some devices.
    coordinates = [
        m[a, 0] * centre[0] + m[a, 1] * centre[1] + m[a, 2] * centre[2] + m[a, 3] for a in range(3)
    ]
    i, j, k = (jnp.floor(axis + TIE).astype(jnp.int32) for axis in coordinates)
    is_inside = is_within(i, source_shape[0]) & is_within(j, source_shape[1]) & is_within(k, source_shape[2])
    # Outside of the source the product may wrap round, and voxel 0 is looked up in its place.
    return jnp.where(is_inside, (i * source_shape[1] + j) * source_shape[2] + k, 0), is_inside


@jax.jit
def take_flat(
    values: Shaped[Array, " n"], index: Int32[Array, " m"], is_inside: Bool[Array, " m"]
) -> Shaped[Array, " m"]:
    """Values at flat indices, 0 where there is none."""
    return jnp.where(is_inside, jnp.asarray(values)[index], jnp.zeros((), values.dtype))


def chunk_size(num_voxels: int) -> int:
    """Length of the runs into which a target of so many voxels is cut."""
    # Small grids share one program; large ones go in pieces that bound the memory of coordinates.
    smallest_chunk = 1 << 15
    largest_chunk = 1 << 20
    return min(bucket_size(num_voxels, smallest_chunk), largest_chunk)


def flat_source(values: np.ndarray) -> jax.Array:
    """A grid as a flat device array, padded to the ladder of shapes."""
    # Sources of few lengths share a program.
    smallest_source = 1 << 15
    padded = np.zeros(bucket_size(values.size, smallest_source), values.dtype)
    padded[: values.size] = values.reshape(-1)
    return jnp.asarray(padded)


@refused_after_fork
def resample_rigid(
    states: UInt8[np.ndarray, "x y z"],
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    T: Float[np.ndarray, "4 4"],
    log_odds: Float32[np.ndarray, "x y z"] | None = None,
) -> tuple[UInt8[np.ndarray, "u v w"], Float64[np.ndarray, "3"], Float32[np.ndarray, "u v w"] | None]:
    """Move a grid by a rigid transform and resample it on the lattice of multiples of its voxel size.

    States and log-odds come from the nearest voxel. The 24 rotations of the cube with whole-voxel
    translations are exact.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the voxels of grid and result [m].
        T: Pose that moves the grid.
        log_odds: Or None.

    Returns:
        States, origin and log-odds (None if not given); one unknown voxel when nothing is known and `T` is
        no rotation of the cube.

    Raises:
        InputError: If the result would have more than 2**31 - 1 voxels, or needs more memory than there is.
    """
    # Bounds and lookups are worked out where numbers are small, and the result is put back by whole cells.
    origin, place = about_middle(origin, states.shape, voxel_size)
    zero = cell_of_image(T, place, voxel_size)
    T = snapped(to_local(T, origin_of_cell(zero, voxel_size), place), voxel_size)
    low, high = moved_bounds(states, origin, voxel_size, T, voxel_size)
    # Where nothing is known, both bounds are one, and a single unknown voxel stands for it.
    shape = np.maximum(high - low, 1)
    advice = "crop it to its known part or coarsen it first"
    check_num_voxels(shape, "the moved map", advice)
    # States and log-odds of the result, and both of the source padded by up to a half on the device.
    per_voxel = 1.0 if log_odds is None else 5.0
    check_memory(per_voxel * (float(np.prod(shape)) + 1.5 * states.size), "the moved map", advice)
    # The pose is applied once, to where each target voxel comes from; states and log-odds share the places.
    affine = source_from_target(T, origin, voxel_size, low, voxel_size)
    num_voxels = int(np.prod(shape))
    moved = np.zeros(num_voxels, np.uint8)
    moved_odds = None if log_odds is None else np.zeros(num_voxels, np.float32)
    if states.size:
        flat = flat_source(states)
        flat_odds = None if log_odds is None else flat_source(log_odds)
        size = chunk_size(num_voxels)
        shapes = np.asarray(states.shape, np.int32), shape.astype(np.int32)
        for start in range(0, num_voxels, size):
            index, inside = lookup_chunk(shapes[0], affine, shapes[1], np.int32(start), size=size)
            count = min(size, num_voxels - start)
            moved[start : start + count] = np.asarray(take_flat(flat, index, inside))[:count]
            if flat_odds is not None and moved_odds is not None:
                moved_odds[start : start + count] = np.asarray(take_flat(flat_odds, index, inside))[:count]
    target = tuple(shape.tolist())
    odds = None if moved_odds is None else moved_odds.reshape(target)
    return moved.reshape(target), origin_of_cell(low + zero, voxel_size), odds
