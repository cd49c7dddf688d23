"""The arrays of a `VoxelGrid`, on host or device: brought to their dtype, and their values checked.

What JAX traces is asked for its dtype alone: its values are not known yet.
"""

import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ._checks import LARGEST_LENGTH, InputError, check_three_axes, shown
from ._types import OCCUPIED, Array


def as_states(value: object) -> Array:
    """States as they are on a device, and as a NumPy array from anywhere else.

    Raises:
        InputError: If they are not uint8.
    """
    array = _as_array("states", value)
    if not _is_placeholder(array) and array.dtype != np.uint8:
        raise InputError(f"states must be uint8 with 0 unknown, 1 free, 2 occupied, got dtype {array.dtype}.")
    return array


def as_float32(name: str, value: object) -> Array:
    """Numbers as float32; those on a device may also be wider, which gradients are checked with.

    Raises:
        InputError: If they are no numbers.
    """
    array = _as_array(name, value)
    if _is_placeholder(array):
        return array
    is_floating = jnp.issubdtype(array.dtype, jnp.floating)  # which NumPy does not know of bfloat16
    if not is_floating and array.dtype.kind not in "iu":
        raise InputError(f"{name} must be an array of numbers, got dtype {array.dtype}.")
    if is_floating and isinstance(array, jax.Array):
        return array
    with np.errstate(over="ignore"):  # what overflows becomes infinite, and is refused as such
        return array if array.dtype == np.float32 else array.astype(np.float32)


def as_place(name: str, value: object) -> Array:
    """A place as float64 on the host, wherever it was: float32 loses it far from the origin of its frame.

    Under JAX's transformations it is what JAX makes of it.

    Raises:
        InputError: If they are not three numbers.
    """
    array = _as_array(name, value)
    if _is_placeholder(array) or isinstance(array, Tracer):
        return array
    host = np.asarray(array)
    if not jnp.issubdtype(host.dtype, jnp.floating) and host.dtype.kind not in "iu":
        raise InputError(f"{name} must be an array of numbers, got dtype {host.dtype}.")
    _check_three(name, host)
    return host.astype(np.float64, copy=False)


def _check_three(name: str, place: Array) -> None:
    if place.shape != (3,):
        raise InputError(f"{name} must have shape (3,), got {place.shape}.")


def _as_array(name: str, value: object) -> Array:
    """Arrays of JAX as they are, all else as a NumPy array."""
    if isinstance(value, jax.Array) or _is_placeholder(value):
        # An array on a device stays there: fetching a large map to look at its dtype would cost a copy.
        return value  # pyright: ignore[reportReturnType]
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers, got {shown(value)}.") from error


def _is_placeholder(value: object) -> bool:
    """Whether a field holds what JAX puts there while it takes trees apart and together."""
    return type(value) is object


def _host_parts(array: Array) -> Iterator[np.ndarray]:
    """The values that this process holds, in as many parts as they lie on devices; none while they are traced."""
    if isinstance(array, np.ndarray):
        yield array
    elif not isinstance(array, Tracer) and not _is_placeholder(array):
        # Replicas hold the same values: one of each part is enough.
        yield from (np.asarray(shard.data) for shard in array.addressable_shards if shard.replica_id == 0)


def check_shapes(states: tuple[int, ...], origin: Array, log_odds: tuple[int, ...] | None) -> None:
    """Refuse fields of a grid that do not fit together; of what JAX traces, its shape is all that is known.

    Args:
        states: Shape of the states.
        origin: Place of the grid.
        log_odds: Shape of the log-odds, None where there are none.

    Raises:
        InputError: If the states have not three axes, the origin not three numbers, or the log-odds another shape.
    """
    check_three_axes("states", states)
    _check_three("origin", origin)
    if log_odds is not None and log_odds != states:
        raise InputError(f"log_odds must have the shape of states {states}, got {log_odds}.")


def check_states(states: Array) -> None:
    """Refuse states that are none.

    Raises:
        InputError: If one is neither 0, 1 nor 2.
    """
    for part in _host_parts(states):
        # States are uint8, which has nothing below 0.
        if part.size and part.max() > OCCUPIED:
            raise InputError(f"states must be 0 unknown, 1 free or 2 occupied, got {part.max()}.")


def check_origin(origin: Array, shape: tuple[int, ...], voxel_size: float) -> None:
    """Refuse a place or a size [m] whose cubes float32 cannot hold.

    Raises:
        InputError: If an origin is not finite, or the grid begins or reaches too far out.
    """
    for part in _host_parts(origin):
        if not (np.abs(part) <= LARGEST_LENGTH).all():  # NaN is not, too
            raise InputError(
                f"origin must be finite numbers within {LARGEST_LENGTH:g} m, got {part.tolist()}."
            )
    if max(shape, default=0) * voxel_size > LARGEST_LENGTH:
        raise InputError(
            f"states of shape {shape} and voxels of {voxel_size:g} m reach beyond {LARGEST_LENGTH:g} m."
        )


def check_log_odds(log_odds: Array) -> None:
    """Refuse log-odds that would spread through sums.

    Raises:
        InputError: If one is NaN or infinite.
    """
    for part in _host_parts(log_odds):
        with np.errstate(over="ignore", invalid="ignore"):
            is_finite = np.isfinite(part.sum())  # one pass without a mask as large as the map
        # A sum of finite values may overflow, so that only a second look at each of them is a proof.
        if not is_finite and not np.isfinite(part).all():
            raise InputError(
                "log_odds must be finite, got NaN or infinite ones; set those of unknown voxels to 0 and cut the "
                "others to OctoMap's limits, -2 and 3.5."
            )


def grid_text(
    shape: tuple[int, ...],
    voxel_size: float,
    extent: tuple[np.ndarray, np.ndarray],
    counts: dict[str, int] | None,
) -> str:
    """A grid in words for one line: its box, and the share of each state.

    Args:
        shape: Number of voxels along x, y, z.
        voxel_size: Width of a voxel [m].
        extent: Lowest and highest corner [m].
        counts: How many voxels have a state, by its name; None where nobody has counted.
    """
    total = max(math.prod(shape), 1)
    shares = "not counted yet"
    if counts is not None:
        shares = ", ".join(
            f"{count:,} {name} ({100 * count / total:.1f} %)" for name, count in counts.items()
        )
    size = " x ".join(map(str, shape))
    box = " ".join(f"{axis} {low:.2f}..{high:.2f}" for axis, low, high in zip("xyz", *extent, strict=True))
    return f"{size} voxels of {voxel_size:g} m, {box} m, {shares}"
