"""Grids made from clouds of points, dense or in blocks, with the free space of the rays to them."""

import math

import numpy as np
from jaxtyping import Float64, UInt8

from ..._checks import LARGEST_LENGTH, InputError, as_float64, check_positive, check_voxel_size
from ..._runtime.memory import check_memory
from ..._types import FREE, OCCUPIED, UNKNOWN
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.voxel_list import blocks_with, count_blocks
from ..blocks.windows import TILE
from .lattice import check_places
from .raycast import crossed_voxels
from .raycast_blocks import states_of_rays

MAX_BLOCK_VOXELS = (1 << 31) * BLOCK_VOXELS
"""Voxels of a box whose blocks int32 counts."""

_ADVICE = (
    "give a larger voxel_size (--voxel-size), or leave points far out away (crop or drop_isolated of vx.read_map, "
    "--crop, --drop-isolated)"
)
_ADVICE_FOR_RAYS = "give a larger voxel_size, or drop points far out (max_range cuts rays)"


def grid_from_points(
    points: object,
    *,
    voxel_size: float,
    sensor_origins: object = None,
    max_range: float | None = None,
    max_voxels: int | None = None,
    most_dense: int = TILE,
) -> tuple[UInt8[np.ndarray, "x y z"] | BlockArray, Float64[np.ndarray, "3"]]:
    """Make the states of a grid from a cloud, its origin on the lattice of multiples of `voxel_size`.

    A voxel that holds a point is occupied; with sensor origins, other voxels that a ray crosses are free.

    Args:
        points: (n, 3) [m].
        voxel_size: Edge length of a voxel [m].
        sensor_origins: None, (3,) for all points or (n, 3), one a point [m].
        max_range: Rays longer than this [m] free space up to it and occupy nothing.
        max_voxels: Largest grid; None for any box.
        most_dense: Larger boxes are in blocks.

    Returns:
        States uint8 (x, y, z) that just hold the points and sensor origins, and the origin float64 (3,) [m].
        A cloud without points gives one unknown voxel.

    Raises:
        InputError: If an argument has a wrong shape, is not finite, or the grid would have too many voxels.
    """
    voxel_size = check_voxel_size(voxel_size)
    cloud = _checked_points("points", points)
    if sensor_origins is None and max_range is not None:
        raise InputError(f"max_range needs sensor_origins, got max_range={max_range!r} without them.")
    if not len(cloud):
        return np.full((1, 1, 1), UNKNOWN, np.uint8), np.zeros(3)
    has_rays = sensor_origins is not None
    # Without sensors each point is a ray of no length, so that one box serves both cases.
    starts = cloud if sensor_origins is None else _checked_origins(sensor_origins, len(cloud))
    ends, is_hit = _cut_rays(starts, cloud, max_range)
    low, shape = _lattice_box(
        np.concatenate([starts, ends]),
        voxel_size,
        MAX_BLOCK_VOXELS if max_voxels is None else min(max_voxels, MAX_BLOCK_VOXELS),
        # Without rays there is no range that could cut any.
        advice=_ADVICE_FOR_RAYS if has_rays else _ADVICE,
    )
    if has_rays:
        _check_steps(starts, ends, voxel_size)
    starts, ends = starts / voxel_size, ends / voxel_size
    # Hits are divided and rounded down as the box and the rays are: none falls outside of the box, or beside its ray.
    hits = np.floor(ends[is_hit]).astype(np.int64) - low
    if math.prod(shape) > most_dense:
        if not has_rays:
            return _sparse_states(hits, shape), low * voxel_size
        states = states_of_rays(starts, ends, is_hit, shape, low=low, advice=_ADVICE_FOR_RAYS)
        return states, low * voxel_size
    _check_memory(shape, voxel_size, has_rays=has_rays)
    # Rays first, points after them: a voxel that holds a point is occupied, whatever else crosses it.
    states = np.full(shape, UNKNOWN, np.uint8)
    if has_rays:
        states[crossed_voxels(starts, ends, shape, low=low)] = FREE
    states[tuple(hits.T)] = OCCUPIED
    return states, low * voxel_size


def _sparse_states(index: np.ndarray, shape: tuple[int, int, int]) -> BlockArray:
    """States of a box in which some voxels are occupied."""
    num_blocks = count_blocks(index)
    # The list in the order of blocks, and the blocks, of which some are held twice.
    need = 32.0 * len(index) + 2.0 * BLOCK_VOXELS * num_blocks
    check_memory(need, f"a grid of {num_blocks:,} blocks of 8 x 8 x 8 voxels", _ADVICE, on_device=False)
    return blocks_with(index, OCCUPIED, shape)


def _checked_points(name: str, points: object) -> np.ndarray:
    """`points` as float64 (n, 3)."""
    cloud = _as_numbers(name, points)
    if cloud.size == 0 and cloud.ndim <= 2 and (cloud.ndim < 2 or cloud.shape[1] in (0, 3)):
        return np.zeros((0, 3))
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise InputError(f"{name} must have shape (n, 3), one x, y, z [m] a row, got shape {cloud.shape}.")
    num_bad = int(np.count_nonzero(~(np.abs(cloud) <= LARGEST_LENGTH).all(axis=1)))  # NaN is not, too
    if num_bad:
        raise InputError(
            f"{name} must be finite and within {LARGEST_LENGTH:g} m, but {num_bad} of {len(cloud)} rows are not; "
            "drop those rows."
        )
    return cloud


def _as_numbers(name: str, values: object) -> np.ndarray:
    """`values` as a float64 array."""
    try:
        return as_float64(values)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers [m], got {type(values).__name__}.") from None


def _checked_origins(sensor_origins: object, num_points: int) -> np.ndarray:
    """One sensor origin a point, float64 (n, 3)."""
    origins = _as_numbers("sensor_origins", sensor_origins)
    if origins.shape not in ((3,), (num_points, 3)):
        raise InputError(
            f"sensor_origins must have shape (3,) or one row a point ({num_points}, 3), got {origins.shape}."
        )
    return np.broadcast_to(_checked_points("sensor_origins", origins.reshape(-1, 3)), (num_points, 3))


def _cut_rays(starts: np.ndarray, ends: np.ndarray, max_range: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Ends cut to the range, and which of them are hits."""
    if max_range is None:
        return ends, np.ones(len(ends), bool)
    limit = check_positive("max_range", max_range, "m")
    length = np.linalg.norm(ends - starts, axis=1)
    is_hit = length <= limit
    # Hits keep their ends; the bound only keeps rays of length 0 from dividing by it.
    scale = np.where(is_hit, 1.0, limit / np.maximum(length, limit))[:, None]
    return np.where(is_hit[:, None], ends, starts + (ends - starts) * scale), is_hit


def _check_memory(shape: tuple[int, int, int], voxel_size: float, *, has_rays: bool) -> None:
    """Refuse a grid for which the memory does not suffice; rays take masks on the device and their copies beside it."""
    num_voxels = shape[0] * shape[1] * shape[2]
    what = f"a grid of {' x '.join(map(str, shape))} voxels of {voxel_size:g} m"
    advice = _ADVICE_FOR_RAYS if has_rays else _ADVICE
    check_memory(num_voxels * (5.0 if has_rays else 1.0), what, advice, on_device=has_rays)


def _check_steps(starts: np.ndarray, ends: np.ndarray, voxel_size: float, *, most: int = 1 << 18) -> None:
    """Refuse a ray [m] that crosses more than `most` voxels: all rays of a batch walk as long as its longest one."""
    longest = float(np.abs(ends - starts).sum(axis=1).max(initial=0.0)) / voxel_size
    if longest > most:
        raise InputError(
            f"a ray crosses {longest:.3g} voxels of {voxel_size:g} m, more than {most:,}; {_ADVICE_FOR_RAYS}."
        )


def _lattice_box(
    places: np.ndarray, voxel_size: float, max_voxels: int, *, advice: str
) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Lowest voxel index int64 (3,) and the shape of the smallest lattice box around places [m]."""
    # Numbers of voxels stay float64 until they are bounded: whole numbers would wrap round before that.
    low = np.floor(places.min(axis=0) / voxel_size)
    size = np.floor(places.max(axis=0) / voxel_size) - low + 1.0
    if float(np.prod(size)) > max_voxels:
        extent = " x ".join(f"{length:.4g}" for length in size * voxel_size)
        raise InputError(
            f"points span {extent} m, which is {np.prod(size):.3g} voxels of {voxel_size:g} m, above the "
            f"limit of {max_voxels:,}; {advice}."
        )
    check_places(
        places,
        voxel_size,
        advice=f"choose an origin near the map (shift of vx.read_map, voxjax convert --shift), or {advice}",
    )
    return low.astype(np.int64), (int(size[0]), int(size[1]), int(size[2]))
