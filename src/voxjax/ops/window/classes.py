"""Sliding cube window: how the number of voxels that it holds changes when the window moves.

Pure kernels on dense grids. Voxels outside the grid count as empty, exactly as if the grid were infinite. Windows are
counted once, on the grid and a margin of one move around it; every direction reads those counts.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import UInt8

from ..._checks import InputError, check_choice, check_whole
from ..._runtime.forks import refused_after_fork
from ..._runtime.placement import is_traced, on_host
from ..._types import Array
from .box import MAX_SIZE as MAX_SIZE
from .box import Occupied as Occupied
from .box import box_count as box_count
from .box import check_occupied, check_shift, check_size
from .box_sums import separable, sums_within
from .class_tiles import classes_in_tiles, is_worth_tiles


def shift_directions(shift: int) -> np.ndarray:
    """The 13 directions of a voxel lattice as moves by `shift` voxels along one, two or three axes, int32 (13, 3)."""
    # A direction and its opposite are one: a change is looked for both ways.
    directions = [d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)]
    return shift * np.asarray(directions, np.int32)


@refused_after_fork
@partial(jax.jit, static_argnames=("size", "shift"))
def count_change(occupied: Occupied, *, size: int = 7, shift: int = 4) -> UInt8[Array, "x y z 13"]:
    """Change of the occupied count when the window moves, per direction (section III).

    The change along a direction is the larger of |count(p + m) - count(p)| and |count(p - m) - count(p)|, as
    a percentage of count(p), where m is the move of `shift_directions(shift)`.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        size: Window edge [voxel]; odd, 1 to 15.
        shift: Voxels moved along each axis of a direction, 1 to 64; size // 2 + 1 takes the window off a face that
            it was centred on.

    Returns:
        uint8 percentages, at most 255, for the 13 directions in the order of `shift_directions`; 0 where the
        window is empty.

    Raises:
        InputError: If `size` is even, below 1 or above 15, or `shift` below 1 or above 64.
    """
    check_occupied(occupied)
    size, shift = check_size(size), check_shift(shift)
    if 0 in occupied.shape:
        return jnp.zeros((*occupied.shape, 13), jnp.uint8)
    counts = _counts_with_margin(occupied, size, shift)
    # In float32, which vectors divide: whole numbers below 2**20 are exact, and `_whole_ratio` mends the quotient.
    here = _moved(counts, occupied.shape, shift, np.zeros(3, np.int32)).astype(jnp.float32)
    # An empty window has no percentage: its quotient is by 1, and its change is made 0.
    bound = jnp.maximum(here, jnp.float32(1))
    percent = []
    for ahead, behind in _pairs(counts, occupied.shape, shift):
        high = jnp.maximum(ahead, behind).astype(jnp.float32)
        low = jnp.minimum(ahead, behind).astype(jnp.float32)
        # The larger of the two changes is up to the larger count or down to the smaller one: no signs
        # need be taken off.
        change = jnp.float32(100) * jnp.maximum(high - here, here - low)
        change = jnp.where(here > 0, jnp.minimum(change, jnp.float32(255) * bound), jnp.float32(0))
        # As uint8 before they are stacked: the stack keeps all 13 in memory.
        percent.append(_whole_ratio(change, bound).astype(jnp.uint8))
    return jnp.stack(percent, axis=-1)


@refused_after_fork
@partial(jax.jit, static_argnames=("size", "shift"))
def count_steady_directions(
    occupied: Occupied, min_change: Array, *, size: int = 7, shift: int = 4
) -> UInt8[Array, "x y z"]:
    """Number of the 13 directions along which the count does not change significantly (section III).

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        min_change: int32 scalar: percentage from which a change (see `count_change`) is significant.
        size: Window edge [voxel]; odd, 1 to 15.
        shift: Voxels moved along each axis of a direction, 1 to 64.

    Returns:
        uint8 in [0, 13].

    Raises:
        InputError: If `size` is even, below 1 or above 15, or `shift` below 1 or above 64.
    """
    check_occupied(occupied)
    size, shift = check_size(size), check_shift(shift)
    if 0 in occupied.shape:
        return jnp.zeros(occupied.shape, jnp.uint8)
    counts = _counts_with_margin(occupied, size, shift)
    return steady_directions(counts, min_change, occupied.shape, shift).astype(jnp.uint8)


@refused_after_fork
def window_classes(
    occupied: Occupied,
    min_change: Array | np.int32,
    *,
    size: int = 7,
    shift: int = 4,
    implementation: str | None = None,
) -> UInt8[Array, "x y z"]:
    """Count and classify at once: flat, edge and corner voxels by their steady directions (section III).

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        min_change: int32 scalar: percentage from which a change (see `count_change`) is significant.
        size: Window edge [voxel]; odd, 1 to 15.
        shift: Voxels moved along each axis of a direction, 1 to 64.
        implementation: "passes": whole-array passes in one kernel, on any device and under JAX's transformations;
            temporary memory of about 3.3 bytes a voxel. "tiles": the same in tiles (`class_tiles`), on a CPU and
            outside of transformations alone; temporary memory of 4 MB a core at most for windows of 7. "pallas": two
            kernels, on a GPU only; the second reads counts only near occupied voxels. None takes "tiles" from four
            million voxels on where they can run, else "passes": "pallas" was not yet measured.

    Returns:
        uint8: 0 not occupied, 1 flat (two steady directions or more), 2 edge (one), 3 corner (none).

    Raises:
        InputError: If `occupied` is no grid, `min_change` no whole number of int32, `size` or `shift` out of range, or
            the implementation unknown.
        NotImplementedError: If "tiles" or "pallas" is asked for where it cannot run.
    """
    check_occupied(occupied)
    min_change, size, shift = check_min_change(min_change), check_size(size), check_shift(shift)
    if implementation is not None:
        check_choice("implementation", implementation, ("passes", "tiles", "pallas"))
    if 0 in occupied.shape:
        return jnp.zeros(occupied.shape, jnp.uint8)
    if implementation == "pallas":
        # Pallas takes a while to import, and most machines never need it.
        from .box_pallas import window_classes_pallas

        return window_classes_pallas(occupied, min_change, size, shift)
    can_be_cut = on_host(occupied, min_change)
    if implementation == "tiles" and not can_be_cut:
        raise NotImplementedError(
            "tiles need a CPU, and values that are not traced; take implementation='passes'."
        )
    if implementation == "passes" or not (can_be_cut and (implementation or is_worth_tiles(occupied.shape))):
        return classes_in_passes(occupied, min_change, size=size, shift=shift)
    classes = partial(classes_within, min_change=min_change, size=size, shift=shift)
    # A class depends on counts one move away, and these on half a window more.
    return classes_in_tiles(classes, occupied, reach=size // 2 + shift)


def check_min_change(min_change: object) -> Array | np.int32:
    """Return `min_change` as the int32 scalar that kernels take; one on the device is left there.

    Raises:
        InputError: If it is no single whole number, or beyond int32. What is below 0 counts as 0.
    """
    dtype, shape = getattr(min_change, "dtype", None), getattr(min_change, "shape", ())
    if shape == () and dtype is not None and dtype.kind != "b" and np.can_cast(dtype, np.int32):
        return jnp.asarray(min_change, jnp.int32) if is_traced(min_change) else min_change  # pyright: ignore[reportReturnType]
    if shape != () or is_traced(min_change):
        raise InputError(
            f"min_change must be a single whole number, got {dtype} of shape {shape}; give numpy.int32(20)."
        )
    limits = np.iinfo(np.int32)
    return np.int32(check_whole("min_change", min_change, limits.min, limits.max))


@partial(jax.jit, static_argnames=("size", "shift"))
def classes_in_passes(
    occupied: Occupied, min_change: Array, *, size: int, shift: int
) -> UInt8[Array, "x y z"]:
    """`window_classes` in one kernel, which holds the counts while it runs; they are no result."""
    counts = _counts_with_margin(occupied, size, shift)
    return classes_of_counts(counts, occupied, min_change, shift)


@partial(jax.jit, static_argnames=("size", "shift"))
def classes_within(
    ones: UInt8[Array, "x y z"], min_change: Array, *, size: int, shift: int
) -> UInt8[Array, "a b c"]:
    """`window_classes` of the inner voxels of a grid of 0 and 1: those whose windows, moved, lie in it as a whole.

    They are `size // 2 + shift` voxels or more from each side of the grid.
    """
    reach = size // 2 + shift
    counts = jax.lax.optimization_barrier(sums_within(ones, size))
    inner = jax.lax.slice(ones, [reach] * 3, [length - reach for length in ones.shape])
    return classes_of_counts(counts, inner, min_change, shift)


def classes_of_counts(counts: Array, occupied: Array, min_change: Array, shift: int) -> jax.Array:
    """Classes as `window_classes` from counts with a margin of `shift` voxels on every side."""
    steady = steady_directions(counts, min_change, occupied.shape, shift)
    three, one = jnp.uint16(3), jnp.uint16(1)
    # A window that moves along a face keeps its count in many directions, along an edge in one, at a corner in none.
    kind = jnp.where(steady >= 2, one, three - steady)
    return jnp.where(jnp.asarray(occupied).astype(jnp.bool_), kind, jnp.uint16(0)).astype(jnp.uint8)


def steady_directions(counts: Array, min_change: Array, shape: tuple[int, ...], shift: int) -> jax.Array:
    """Number of directions without a significant change, uint16, from counts with a margin of `shift` voxels.

    100 |there - here| < min_change * here, for both senses, is |there - here| < t with t the quotient rounded up: one
    subtraction and one comparison of uint16 each, the wrap of negative numbers included.
    """
    # 400,000 % of any count is more than any change, and times the largest count fits int32.
    most_percent = 400_000
    more_than_any_change = MAX_SIZE**3 + 1
    here = _moved(counts, shape, shift, np.zeros(3, np.int32))
    percent = jnp.clip(jnp.asarray(min_change, jnp.int32), 0, most_percent)
    quotient = jax.lax.div(percent * here.astype(jnp.int32) + 99, jnp.int32(100))
    bound = jnp.minimum(quotient, more_than_any_change).astype(jnp.uint16)
    # Differences below `lowest` wrap to large numbers, so one comparison bounds them on both sides.
    lowest = here - bound + jnp.uint16(1)
    width = jnp.where(bound > 0, jnp.uint16(2) * bound - jnp.uint16(1), jnp.uint16(0))
    steady = jnp.zeros(shape, jnp.uint16)
    for ahead, behind in _pairs(counts, shape, shift):
        steady += ((ahead - lowest < width) & (behind - lowest < width)).astype(jnp.uint16)
    return steady


def _counts_with_margin(occupied: Array, size: int, shift: int) -> jax.Array:
    """Counts of the grid and `shift` voxels around it; the barrier keeps them from being summed for each direction."""
    is_occupied = jnp.asarray(occupied).astype(jnp.bool_)
    return jax.lax.optimization_barrier(separable(is_occupied, size, margin=shift))


def _pairs(counts: Array, shape: tuple[int, ...], shift: int) -> Iterator[tuple[jax.Array, jax.Array]]:
    """Counts one move ahead and one behind, for each of the 13 directions."""
    for move in shift_directions(shift):
        yield _moved(counts, shape, shift, move), _moved(counts, shape, shift, -move)


def _moved(counts: Array, shape: tuple[int, ...], shift: int, move: np.ndarray) -> jax.Array:
    """Counts at each voxel plus `move`."""
    start = [shift + int(m) for m in move]
    return jax.lax.slice(counts, start, [s + n for s, n in zip(start, shape, strict=True)])


def _whole_ratio(numerator: Array, denominator: Array) -> jax.Array:
    """Quotient rounded down of whole float32 below 2**20, exactly; integers are not divided in vectors."""
    ratio = jnp.floor(numerator / denominator)
    # Division on a GPU may be off by some units in the last place, enough to miss a whole number by one.
    rest = numerator - ratio * denominator
    return ratio + (rest >= denominator).astype(jnp.float32) - (rest < 0).astype(jnp.float32)
