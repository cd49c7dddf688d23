"""Truncated Euclidean distance field with the nearest occupied voxel, dense, axis by axis.

A voxel's key holds the squared distance to the nearest occupied voxel found so far and the way to it, so that the
least key is the nearest voxel, and the first one in C order among equally near ones. `nearest` serves lists of voxels
in blocks whose shape is not known at compilation; this module is the quicker one for a grid of known shape.

No stage of the pipeline uses it; it is a door of its own for planning and for distances of whole grids.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt16, UInt32

from .._checks import InputError, check_positive
from .._runtime.forks import refused_after_fork
from .._types import Array

MAX_RADIUS = 15
"""Squared distances up to 225 fit the key's eight bits, steps along an axis its five."""

_NOTHING_8 = np.uint8(0xFF)
_NOTHING_16 = np.uint16(0xFFFF)
_NOTHING_32 = np.uint32(0xFFFFFFFF)
_MIDDLE = 16
"""A step s along x or y is stored as s + 16; that along z by its sign, its length follows from the rest."""


class DistanceField(NamedTuple):
    """Where the nearest occupied voxel is, for every voxel of a grid.

    Attributes:
        distance: float32 (x, y, z) [m]: between the centres of the voxels, truncated at the radius.
        nearest: int32 (x, y, z): flat index (C order) of the nearest occupied voxel, the lowest one of equally near
            ones; -1 where none is within the radius.
    """

    distance: Float32[Array, "x y z"]
    nearest: Int32[Array, "x y z"]


@refused_after_fork
def distance_field(
    occupied: Bool[Array, "x y z"], *, radius: int, voxel_size: float | Float32[Array, ""]
) -> DistanceField:
    """Distance to the nearest occupied voxel, exact up to `radius`, and which one that is.

    Equals `min(radius, edt(~occupied))` of an exact Euclidean distance transform. Work grows with the number of
    voxels times the radius; the two results hold 8 bytes a voxel and the passes need 6 more.

    Args:
        occupied: True where a voxel is occupied; its shape is static under jit.
        radius: Reach [voxel], 1 to 15; static.
        voxel_size: Edge of a voxel [m]; may be traced.

    Returns:
        `DistanceField`.

    Raises:
        InputError: If the radius is out of range, the voxel size not positive or the grid too large for int32.

    References:
        Separable squared distance transform: Felzenszwalb and Huttenlocher, Distance Transforms of Sampled Functions,
        2012; the truncation turns its parabolas into a fixed number of shifts.
    """
    if not 1 <= radius <= MAX_RADIUS:
        raise InputError(f"radius must be a whole number of voxels from 1 to {MAX_RADIUS}, got {radius!r}.")
    if occupied.size >= 2**31:
        raise InputError(f"occupied must have fewer than 2**31 voxels, got {occupied.size}; use tiles.")
    # A voxel size that is traced has no value to check.
    if not isinstance(voxel_size, jax.Array):
        voxel_size = check_positive("voxel_size", float(voxel_size), "m")
    return _distance_field(occupied, jnp.asarray(voxel_size, jnp.float32), radius=radius)


@partial(jax.jit, static_argnames=("radius",))
def _distance_field(occupied: Array, voxel_size: Array, *, radius: int) -> DistanceField:
    # Barriers: fused into one kernel, a pass would be computed again for every shift of the next one.
    # A pass widens its keys no more than it must (8, 16, 32 bits), so that the first two move few bytes.
    along_z = jax.lax.optimization_barrier(_pass_z(occupied, radius))
    along_y = jax.lax.optimization_barrier(_pass_y(along_z, radius))
    keys = jax.lax.optimization_barrier(_pass_x(along_y, radius))
    return _decode(keys, voxel_size, radius)


def _pass_z(occupied: Array, radius: int) -> UInt8[Array, "x y z"]:
    """Twice the distance along z, plus 1 toward higher z, 255 beyond the radius; doubling steps."""
    # Keys are exact up to `reached`; those one voxel farther away than that know as far again, so that it doubles.
    key = jnp.where(occupied, np.uint8(0), _NOTHING_8)
    reached = 0
    while reached < radius:
        step = min(reached + 1, radius - reached)
        longer = np.uint8(2 * step)
        best, shifted = key, _shifts(key, 2, step, _NOTHING_8)
        for sign in (-1, 1):
            other = shifted(sign * step)
            # A key of 0 has no direction yet; any other keeps its own, which must be that of this step.
            way = np.uint8(sign > 0)
            # Of two voxels at one distance, the one below has the smaller key, as C order wants it.
            is_same_way = (other == 0) | ((other & 1) == way)
            candidate = jnp.where(other == 0, longer + way, other + longer)
            # Keys of distances stay below 32 and cannot wrap; what comes of adding to 255 is told by the
            # 255, and not taken.
            best = jnp.minimum(best, jnp.where(is_same_way & (other < _NOTHING_8), candidate, _NOTHING_8))
        key, reached = best, reached + step
    return key


def _pass_y(key: Array, radius: int) -> UInt16[Array, "x y z"]:
    """Least squared distance << 6 | step along y << 1 | whether z rises, over steps along y."""
    length = (key >> 1).astype(jnp.uint16)
    start = jnp.where(key == _NOTHING_8, _NOTHING_16, (length * length) << 6 | (key & 1).astype(jnp.uint16))
    best = jnp.full(key.shape, _NOTHING_16)
    shifted = _shifts(start, 1, radius, _NOTHING_16)
    for step in range(-radius, radius + 1):
        other = shifted(step)
        added = np.uint16((step * step) << 6 | (step + _MIDDLE) << 1)
        # Compared before the sum, which wraps round where nothing was near.
        # The six low bits of a key are less than one step of its distance: this is `distance <= radius² - step²`.
        is_near = other < np.uint16((radius * radius - step * step + 1) << 6)
        best = jnp.minimum(best, jnp.where(is_near, other + added, _NOTHING_16))
    return best


def _pass_x(key: Array, radius: int) -> UInt32[Array, "x y z"]:
    """Least squared distance << 11 | step along x << 6 | what came before, over steps along x."""
    best = jnp.full(key.shape, _NOTHING_32)
    shifted = _shifts(key, 0, radius, _NOTHING_16)
    for step in range(-radius, radius + 1):
        other = shifted(step)
        # Widened after the shift: half the bytes to read.
        wide = (other >> 6).astype(jnp.uint32) << 11 | (other & 63).astype(jnp.uint32)
        # Below the distance stand the steps along x, y and z, in this order: the least key is the first
        # voxel in C order.
        added = np.uint32((step * step) << 11 | (step + _MIDDLE) << 6)
        is_near = other < np.uint16((radius * radius - step * step + 1) << 6)
        best = jnp.minimum(best, jnp.where(is_near, wide + added, _NOTHING_32))
    return best


def _decode(key: Array, voxel_size: Array, radius: int) -> DistanceField:
    """Distances [m] and flat indices from keys."""
    squared = (key >> 11).astype(jnp.int32)
    dx = ((key >> 6) & 31).astype(jnp.int32) - _MIDDLE
    dy = ((key >> 1) & 31).astype(jnp.int32) - _MIDDLE
    # What x and y leave of the squared distance is that of z, a whole number; rounding the root takes out its error.
    rest = jnp.maximum(squared - dx * dx - dy * dy, 0).astype(jnp.float32)
    length = jnp.round(jnp.sqrt(rest)).astype(jnp.int32)
    dz = jnp.where((key & 1) == 1, length, -length)
    _, height, depth = key.shape
    own = jax.lax.broadcasted_iota(jnp.int32, (key.size,), 0).reshape(key.shape)
    is_near = key != _NOTHING_32
    nearest = jnp.where(is_near, own + (dx * height + dy) * depth + dz, -1)
    distance = jnp.where(is_near, jnp.sqrt(squared.astype(jnp.float32)), np.float32(radius))
    return DistanceField(distance * voxel_size, nearest)


def _shifts(values: Array, axis: int, reach: int, outside: np.unsignedinteger) -> Callable[[int], Array]:
    """A function that gives `values` at `place + step` along an axis, `outside` beyond the grid.

    The halo is made once, behind a barrier: XLA joins slices of an array into one vector loop, but not concatenations.
    """
    slab = list(values.shape)
    slab[axis] = reach
    beyond = jnp.full(tuple(slab), outside)
    wide = jax.lax.optimization_barrier(jnp.concatenate([beyond, values, beyond], axis))
    return lambda step: jax.lax.slice_in_dim(wide, reach + step, reach + step + values.shape[axis], axis=axis)
