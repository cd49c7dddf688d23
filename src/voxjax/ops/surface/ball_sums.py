"""Sums over the occupied and the free voxels of a ball around listed voxels, from one bit a voxel.

The states lie packed along z. One word of the packed block holds all that a window can need of one column, so a ball
of diameter 7 costs 37 lookups a voxel and not 179, and sums along z are counts of bits. All sums are exact.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int, Int32, UInt32

from ..._types import Array
from .packed_states import PackedStates


def ball_offsets(size: int) -> np.ndarray:
    """Voxel offsets int32 (k, 3) within size / 2 of the centre: a ball treats all directions alike."""
    half = size // 2
    axis = np.arange(-half, half + 1)
    offsets = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return offsets[(offsets**2).sum(axis=1) <= (size / 2) ** 2].astype(np.int32)


def window_sums(
    packed: PackedStates, group: Int32[Array, "n"], shift: UInt32[Array, "n"], *, size: int
) -> Int[Array, "14 n"]:
    """Sums over the ball of diameter `size` around each voxel, offsets counted from the voxel.

    Args:
        packed: The states.
        group: The word that the voxel's column of the window begins in.
        shift: Where in that word it begins: bit 0 after the shift is the voxel `size // 2` below.
        size: Diameter [voxel]; odd.

    Returns:
        Sums over the occupied voxels of 1, x, y, z, xx, yy, zz, xy, xz, yz and over the free ones of 1, x, y, z; int16
        up to diameter 7, int32 beyond.
    """
    # Largest diameter whose sums over one plane of the ball fit 8 bits, and all its sums 16.
    small = 7
    half = size // 2
    columns = _columns(size)
    steps = packed.steps(jnp.asarray(columns[:, 0]), jnp.asarray(columns[:, 1]))
    # A column of the window has `size` bits, so that those of a small window fit a byte.
    narrow = jnp.uint8 if size <= small else jnp.uint32
    masks = jnp.asarray(columns[:, 2], jnp.uint32)[:, None]
    occupied, free = (
        (bits & masks).astype(narrow) for bits in packed.look(steps[:, None] + group[None, :], shift[None, :])
    )
    # Along z a sum of weights is counts of bits, one for each binary digit of the weights; x and y are constants of a
    # column, so their powers multiply what its bits give. A term names the weights along z and the powers of x and y.
    axis = np.arange(-half, half + 1)
    one, z, zz = (_digits(weights) for weights in (np.ones_like(axis), axis, axis**2))
    terms = (
        (one, 0, 0),
        (one, 1, 0),
        (one, 0, 1),
        (z, 0, 0),
        (one, 2, 0),
        (one, 0, 2),
        (zz, 0, 0),
        (one, 1, 1),
        (z, 1, 0),
        (z, 0, 1),
    )
    rows = [_weighted_sum(occupied, columns, *term) for term in terms]
    # Free voxels only tell on which side space is free: their products are not needed.
    rows += [_weighted_sum(free, columns, *term) for term in terms[:4]]
    return jnp.stack(rows)


def _columns(size: int) -> np.ndarray:
    """Columns of the ball: x, y, and the bits along z that belong to it; int32 (k, 3), in the order of x."""
    bits: dict[tuple[int, int], int] = {}
    for x, y, z in ball_offsets(size).tolist():
        # Bit 0 is the lowest voxel of the window, for `window_sums` is given where that one lies.
        bits[x, y] = bits.get((x, y), 0) | 1 << (z + size // 2)
    return np.asarray([(x, y, mask) for (x, y), mask in bits.items()], np.int32)


class _Digits(NamedTuple):
    """A sum of whole weights over the bits of a word, as counts of bits: one mask a binary digit of the weights.

    Attributes:
        masks: For each digit the bits counted, those of them counted when zero, and the digit's value.
        excess: What the counts exceed the sum by: a bit of weight -1 is counted when zero, which is one too many.
    """

    masks: tuple[tuple[int, int, int], ...]
    excess: int


def _digits(weights: np.ndarray) -> _Digits:
    masks, excess = [], 0
    for digit in range(int(np.abs(weights).max()).bit_length()):
        has_digit = (np.abs(weights) >> digit) & 1 == 1
        counted, flipped = (
            sum(1 << int(k) for k in np.flatnonzero(where))
            for where in (has_digit, has_digit & (weights < 0))
        )
        masks.append((counted, flipped, 1 << digit))
        excess += flipped.bit_count() << digit
    # A digit that no weight has would count nothing: 9, 4 and 1 have no twos.
    return _Digits(tuple(mask for mask in masks if mask[0]), excess)


def _weighted_sum(bits: Array, columns: np.ndarray, digits: _Digits, power_x: int, power_y: int) -> Array:
    """Sum of x**power_x * y**power_y * (sum along z) over the columns.

    Planes of equal x are summed first, in 8 bits where they fit: four times as many at once as in 32.
    """
    # Sums along z are negative only where weights are, and a product with y only for odd powers; the
    # others have a bit more.
    is_signed = digits.excess > 0 or power_y == 1
    small = bits.dtype == jnp.uint8
    narrow, wide = (
        (np.dtype(np.int8 if is_signed else np.uint8), np.dtype(np.int16))
        if small
        else (np.dtype(np.int32),) * 2
    )
    # Columns without weight are left out, and planes of equal x are multiplied once, when they are summed.
    planes: dict[tuple[int, int], Array] = {}
    for k, (x, y, _) in enumerate(columns.tolist()):
        weight_x, weight_y = x**power_x, y**power_y
        if weight_x and weight_y and digits.masks:
            part = _times(_sum_along_z(bits[k], digits, narrow), weight_y)
            planes[weight_x, x] = planes[weight_x, x] + part if (weight_x, x) in planes else part
    if not planes:
        return jnp.zeros(bits.shape[1:], wide)
    parts = [_times(plane.astype(wide), weight) for (weight, _), plane in planes.items()]
    return functools.reduce(jnp.add, parts)


def _sum_along_z(column: Array, digits: _Digits, dtype: np.dtype) -> Array:
    parts = []
    for counted, flipped, value in digits.masks:
        bits = (column ^ np.array(flipped, column.dtype)) & np.array(counted, column.dtype)
        parts.append(_times(jax.lax.population_count(bits).astype(dtype), value))
    total = functools.reduce(jnp.add, parts)
    return total - np.array(digits.excess, dtype) if digits.excess else total


def _times(values: Array, weight: int) -> Array:
    return values if weight == 1 else values * np.array(weight, values.dtype)
