"""Sliding cube window: how many voxels it holds, and how that number changes when the window moves.

Pure kernels on dense grids. Voxels outside the grid count as empty, exactly as if the grid were infinite.
"""

from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, UInt8, UInt16

from .._checks import InputError, check_choice, check_odd_window
from .._types import Array

Occupied = Bool[Array, "x y z"] | UInt8[Array, "x y z"]

MAX_SIZE = 15
"""Largest window: two summed axes then hold at most 225 voxels, which fits uint8."""


@partial(jax.jit, static_argnames=("size", "implementation"))
def box_count(
    occupied: Occupied, *, size: int = 7, implementation: str | None = None
) -> UInt16[Array, "x y z"]:
    """Count the occupied voxels in the cube window centred on each voxel (section III).

    Equal to `scipy.ndimage.correlate(occupied, ones((size,) * 3), mode="constant")`, exactly.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        size: Window edge [voxel]; odd, 1 to 15.
        implementation: "separable": three passes of log-step adds in uint8, uint8, uint16, 4-5 bytes moved
            per voxel; "summed_area": one integral image in uint32, work independent of `size`. None takes
            "separable", the faster one at every size on CPU (measured: 256 cubed, size 7, 35 times).

    Returns:
        uint16 counts in [0, size**3], shape of the input.

    Raises:
        InputError: If `size` is even, below 1 or above 15, or the implementation is unknown.
    """
    size = check_odd_window("size", size)
    if size > MAX_SIZE:
        raise InputError(f"size must be at most {MAX_SIZE} voxels, got {size}.")
    if implementation is not None:
        check_choice("implementation", implementation, ("separable", "summed_area"))
    if 0 in occupied.shape:
        return jnp.zeros(occupied.shape, jnp.uint16)
    is_occupied = jnp.asarray(occupied).astype(jnp.bool_)
    return (
        _summed_area(is_occupied, size) if implementation == "summed_area" else _separable(is_occupied, size)
    )


def _separable(is_occupied: Array, size: int) -> Array:
    """Three one-dimensional sums; the barrier keeps XLA from fusing them into one slow loop."""
    counts = is_occupied.astype(jnp.uint8)
    for axis, dtype in ((2, jnp.uint8), (1, jnp.uint8), (0, jnp.uint16)):
        counts = jax.lax.optimization_barrier(_sum_along(counts.astype(dtype), axis, size))
    return counts


def _sum_along(values: Array, axis: int, size: int) -> Array:
    """Centred sum of `size` neighbours along one axis, built from sums of 1, 2, 4, 8 terms."""
    length = values.shape[axis]
    slab_shape = list(values.shape)
    slab_shape[axis] = size // 2
    # Concatenation of zero slabs is several times faster than `jnp.pad` on CPU.
    slab = jnp.zeros(slab_shape, values.dtype)
    terms = jnp.concatenate([slab, values, slab], axis=axis)
    total, start, width = None, 0, 1
    while True:
        if size & width:
            part = jax.lax.slice_in_dim(terms, start, start + length, axis=axis)
            total = part if total is None else total + part
            start += width
        if width * 2 > size:
            return total  # pyright: ignore[reportReturnType]
        count = terms.shape[axis] - width
        terms = jax.lax.slice_in_dim(terms, 0, count, axis=axis) + jax.lax.slice_in_dim(
            terms, width, width + count, axis=axis
        )
        width *= 2


def _summed_area(is_occupied: Array, size: int) -> Array:
    """Integral image and eight looked-up corners, one axis at a time."""
    half = size // 2
    table = is_occupied.astype(jnp.uint32)
    for axis in range(3):
        length = table.shape[axis]
        pad = [(0, 0)] * 3
        pad[axis] = (half + 1, half)
        sums = jnp.cumsum(jnp.pad(table, pad), axis=axis, dtype=jnp.uint32)
        high = jax.lax.slice_in_dim(sums, size, size + length, axis=axis)
        table = high - jax.lax.slice_in_dim(sums, 0, length, axis=axis)
    return table.astype(jnp.uint16)


def shift_directions(shift: int) -> np.ndarray:
    """The 13 directions of a voxel lattice as moves by `shift` voxels along one, two or three axes, int32 (13, 3)."""
    directions = [d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)]
    return shift * np.asarray(directions, np.int32)


def _changes(occupied: Array, size: int, shift: int) -> tuple[jax.Array, list[jax.Array]]:
    """Counts, and for each of the 13 directions the larger change of the two senses; int32."""
    padded = jnp.pad(jnp.asarray(occupied).astype(jnp.bool_), shift)
    counts = box_count(padded, size=size).astype(jnp.int32)

    def moved(move: np.ndarray) -> jax.Array:
        start = [shift + int(m) for m in move]
        return jax.lax.slice(counts, start, [s + n for s, n in zip(start, occupied.shape, strict=True)])

    here = moved(np.zeros(3, np.int32))
    changes = [
        jnp.maximum(jnp.abs(moved(move) - here), jnp.abs(moved(-move) - here))
        for move in shift_directions(shift)
    ]
    return here, changes


@partial(jax.jit, static_argnames=("size", "shift"))
def count_change(occupied: Occupied, *, size: int = 7, shift: int = 4) -> UInt8[Array, "x y z 13"]:
    """Change of the occupied count when the window moves, per direction (section III).

    The change along a direction is the larger of |count(p + m) - count(p)| and |count(p - m) - count(p)|, as
    a percentage of count(p), where m is the move of `shift_directions(shift)`.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        size: Window edge [voxel].
        shift: Voxels moved along each axis of a direction, at least 1; size // 2 + 1 takes the window off a face that
            it was centred on.

    Returns:
        uint8 percentages, at most 255, for the 13 directions in the order of `shift_directions`; 0 where the
        window is empty.
    """
    if any(n == 0 for n in occupied.shape):
        return jnp.zeros((*occupied.shape, 13), jnp.uint8)
    here, changes = _changes(occupied, check_odd_window("size", size), shift)
    percent = [jnp.minimum(100 * change // jnp.maximum(here, 1), 255) for change in changes]
    return jnp.where(here[..., None] > 0, jnp.stack(percent, axis=-1), 0).astype(jnp.uint8)


@partial(jax.jit, static_argnames=("size", "shift"))
def count_steady_directions(
    occupied: Occupied, min_change: Array, *, size: int = 7, shift: int = 4
) -> UInt8[Array, "x y z"]:
    """Number of the 13 directions along which the count does not change significantly (section III).

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        min_change: int32 scalar: percentage from which a change (see `count_change`) is significant.
        size: Window edge [voxel].
        shift: Voxels moved along each axis of a direction.

    Returns:
        uint8 in [0, 13].
    """
    if any(n == 0 for n in occupied.shape):
        return jnp.zeros(occupied.shape, jnp.uint8)
    here, changes = _changes(occupied, check_odd_window("size", size), shift)
    bound = jnp.asarray(min_change, jnp.int32) * here
    return sum((100 * change < bound).astype(jnp.uint8) for change in changes).astype(jnp.uint8)  # pyright: ignore
