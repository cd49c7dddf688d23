"""How many occupied voxels the cube window around each voxel holds: one function, several implementations."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, UInt8, UInt16

from ..._checks import InputError, check_choice, check_count, check_odd_window, check_three_axes, shown
from ..._runtime.forks import refused_after_fork
from ..._types import Array
from . import box_sums

Occupied = Bool[Array, "x y z"] | UInt8[Array, "x y z"]

MAX_SIZE = 15
"""Largest window: two summed axes then hold at most 225 voxels, which fits uint8."""

MAX_SHIFT = 64
"""Farthest move of a window: windows share nothing from their own size on, and grids are padded by the move."""

# These run on any device; the Pallas kernel runs on one kind alone, and is only imported where it is asked for.
_PASSES = {
    "separable": box_sums.separable,
    "packed": box_sums.packed,
    "summed_area": box_sums.summed_area,
}
IMPLEMENTATIONS = (*_PASSES, "pallas")


@refused_after_fork
@partial(jax.jit, static_argnames=("size", "implementation"))
def box_count(
    occupied: Occupied, *, size: int = 7, implementation: str | None = None
) -> UInt16[Array, "x y z"]:
    """Count the occupied voxels in the cube window centred on each voxel (section III).

    Equal to `scipy.ndimage.correlate(occupied, ones((size,) * 3), mode="constant")`, exactly, by whichever
    implementation.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        size: Window edge [voxel]; odd, 1 to 15.
        implementation: "separable": one pass per axis in uint8, uint8, uint16. "packed": the first pass from
            words of 32 voxels. "summed_area": an integral image in uint32, work independent of `size`. "pallas":
            one kernel that reads the grid once and writes the counts once, on a GPU only. None takes "separable"
            on every device: on a CPU it is faster than "packed" wherever the process keeps its memory (fresh pages
            may cost several times either), and the kernel was not yet measured on a GPU: `python -m bench kernels`
            compares all of them.

    Returns:
        uint16 counts in [0, size**3], shape of the input. Temporary memory is about 1 byte per voxel, with
        "summed_area" 9, with "pallas" none.

    Raises:
        InputError: If `occupied` is no grid, `size` even, below 1 or above 15, or the implementation unknown.
        NotImplementedError: If "pallas" is asked for where it cannot run.
    """
    check_occupied(occupied)
    size = check_size(size)
    if implementation is not None:
        check_choice("implementation", implementation, IMPLEMENTATIONS)
    if 0 in occupied.shape:
        return jnp.zeros(occupied.shape, jnp.uint16)
    if implementation == "pallas":
        # Pallas takes a while to import, and most machines never need it.
        from .box_pallas import box_count_pallas

        return box_count_pallas(jnp.asarray(occupied), size)
    # The passes add up what they are given, so a byte of 2 has to count as one before.
    is_occupied = jnp.asarray(occupied).astype(jnp.bool_)
    return _PASSES[implementation or "separable"](is_occupied, size)


def check_occupied(occupied: object) -> None:
    """Raise if a kernel cannot take it for a grid.

    Raises:
        InputError: If it is a list, which JAX would take apart into one argument a voxel, or has not three axes.
    """
    if not hasattr(occupied, "shape"):
        raise InputError(
            f"occupied must be an array, got a {type(occupied).__name__}; make one of it with numpy.asarray."
        )
    check_three_axes("occupied", occupied.shape)  # pyright: ignore[reportAttributeAccessIssue]


def check_size(size: int) -> int:
    """Return `size` if a window can have it.

    Raises:
        InputError: If it is even, below 1 or above 15.
    """
    size = check_odd_window("size", size)
    if size > MAX_SIZE:
        raise InputError(f"size must be at most {MAX_SIZE} voxels, got {size}.")
    return size


def check_shift(shift: object) -> int:
    """Return `shift` if a window can be moved by so many voxels.

    Raises:
        InputError: If it is no whole number from 1 to 64: every side of the grid is padded by as much.
    """
    shift = check_count("shift", shift, 1)
    if shift > MAX_SHIFT:
        raise InputError(f"shift must be at most {MAX_SHIFT} voxels, got {shown(shift)}.")
    return shift
