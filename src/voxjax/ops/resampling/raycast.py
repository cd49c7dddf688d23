"""Ray casting on the voxel lattice: which voxels a ray crosses, and grids made from clouds.

`walk_rays` is the kernel: it walks all rays in lock step from voxel to voxel, exactly. The
host functions around it cut rays into batches of similar length, so that memory is bounded and no ray waits
long for another.
"""

import math
from collections.abc import Callable, Iterator
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from ..._checks import LARGEST_LENGTH, InputError, as_float64, check_positive, check_voxel_size
from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory
from ..._types import FREE, OCCUPIED, UNKNOWN, Array
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.voxel_list import blocks_with, count_blocks
from ..blocks.windows import TILE
from .lattice import MAX_VOXELS, check_places

MAX_BLOCK_VOXELS = (1 << 31) * BLOCK_VOXELS
"""Voxels of a box whose blocks int32 counts."""

_ADVICE = "give a larger voxel_size, or drop points far out (max_range cuts rays)"

_RAYS_PER_BATCH = 4096
"""Rays that walk together: memory is bounded, and rays of one batch are of similar length."""

State = TypeVar("State")


def walk_rays(
    state: State,
    visit: Callable[[State, jax.Array], State],
    start_index: Int32[Array, "n 3"],
    start_offset: Float32[Array, "n 3"],
    end_index: Int32[Array, "n 3"],
    end_offset: Float32[Array, "n 3"],
    strides: Int32[Array, "3"],
    mask: Bool[Array, " n"],
) -> State:
    """Walk all rays in lock step from voxel to voxel, start and end included; to be called inside a jit.

    A ray steps to the next voxel along the axis whose lattice plane it meets first (Amanatides and Woo,
    1987). The number of steps along each axis is known from the two indices, so rounding can swap two steps
    that fall together but cannot miss the end voxel.

    Args:
        state: What `visit` works on, any pytree.
        visit: Given the state and the flat index int32 (n,) of the voxel where each ray is, the new state. A
            ray that has ended stays in its end voxel; a masked one is at the largest int32.
        start_index: Voxel of each start.
        start_offset: Place of the start inside its voxel, in [0, 1) [voxel].
        end_index: Voxel of each end.
        end_offset: Place of the end inside its voxel, in [0, 1) [voxel].
        strides: Distance of neighbours along x, y, z in the flat grid.
        mask: True for the rays that count.

    Returns:
        The state after the last visit.
    """
    steps_index = end_index - start_index
    steps = jnp.where(mask[:, None], jnp.abs(steps_index), 0).T
    displacement = steps_index.astype(jnp.float32) + (end_offset - start_offset)
    # Rays without a step along an axis never use its times, so any positive length will do there.
    length = jnp.where(steps_index != 0, jnp.abs(displacement), jnp.float32(1.0))
    # Time runs from 0 at the start of a ray to 1 at its end: when it meets the first plane across each axis, and how
    # long it goes from one to the next.
    to_first_plane = jnp.where(steps_index > 0, jnp.float32(1.0) - start_offset, start_offset)
    first, interval = (to_first_plane / length).T, (jnp.float32(1.0) / length).T
    flat_step = (jnp.sign(steps_index) * strides[None, :]).T
    start_flat = jnp.sum(start_index * strides[None, :], axis=1, dtype=jnp.int32)
    # A masked ray has no steps, so it never moves on from this number, which no grid has: what marks voxels drops it.
    flat = jnp.where(mask, start_flat, jnp.iinfo(jnp.int32).max)
    # All rays walk as many rounds as the longest one has steps; those that have ended stand still.
    num_rounds = jnp.max(jnp.sum(steps, axis=0, dtype=jnp.int32), initial=0)

    def step(carry: tuple) -> tuple:
        done, flat, counts, state = carry
        # The times of planes are products, not sums: no error grows along a ray. A tie goes to x, then y, so that each
        # ray takes one step a round.
        is_left = counts < steps
        # An axis whose steps are all done has no next plane, so that rounding cannot carry a ray past its end.
        times = jnp.where(is_left, first + counts.astype(jnp.float32) * interval, jnp.inf)
        takes_x = (times[0] <= times[1]) & (times[0] <= times[2])
        takes_y = ~takes_x & (times[1] <= times[2])
        moves = jnp.stack([takes_x, takes_y, ~takes_x & ~takes_y]) & is_left
        flat = flat + jnp.sum(jnp.where(moves, flat_step, 0), axis=0, dtype=jnp.int32)
        return done + 1, flat, counts + moves.astype(jnp.int32), visit(state, flat)

    # The voxel of the start is visited before any step.
    carry = (jnp.int32(0), flat, jnp.zeros_like(steps), visit(state, flat))
    return jax.lax.while_loop(lambda c: c[0] < num_rounds, step, carry)[3]


@jax.jit
def mark_crossed_voxels(
    is_crossed: Bool[Array, " v"],
    start_index: Int32[Array, "n 3"],
    start_offset: Float32[Array, "n 3"],
    end_index: Int32[Array, "n 3"],
    end_offset: Float32[Array, "n 3"],
    strides: Int32[Array, "3"],
    mask: Bool[Array, " n"],
) -> Bool[Array, " v"]:
    """Mark the voxels of a flat grid that straight rays cross, start and end voxels included.

    The rays are given as in `walk_rays`. All voxels on their way must be inside the grid: an index beyond one side of
    it is one of another row.

    Returns:
        `is_crossed` with more voxels marked.
    """

    def mark(marked: jax.Array, flat: jax.Array) -> jax.Array:
        return marked.at[flat].set(True, mode="drop")

    rays = (start_index, start_offset, end_index, end_offset, strides, mask)
    return walk_rays(jnp.asarray(is_crossed), mark, *rays)


def ray_batches(
    starts: np.ndarray, ends: np.ndarray, low: np.ndarray | None = None
) -> Iterator[tuple[np.ndarray, ...]]:
    """Cut rays into padded batches of similar length.

    Args:
        starts: (n, 3) [voxel].
        ends: (n, 3), likewise.
        low: The grid's lowest voxel, whole numbers (3,); None if places are counted from the grid's outer corner.

    Yields:
        start_index, start_offset, end_index, end_offset and mask, as `walk_rays` takes them.
    """
    low = np.zeros(3) if low is None else low
    start_index, start_offset = _split(starts, low)
    end_index, end_offset = _split(ends, low)
    order = np.argsort(np.abs(end_index - start_index).sum(axis=1), kind="stable")
    # Few rays share one shape: padding costs less than a compilation.
    size = bucket_size(min(len(order), _RAYS_PER_BATCH), 512)
    for first in range(0, len(order), _RAYS_PER_BATCH):
        batch = order[first : first + _RAYS_PER_BATCH]
        rows = (start_index, start_offset, end_index, end_offset)
        yield *(pad_rows(array[batch], size) for array in rows), np.arange(size) < len(batch)


def flat_strides(shape: tuple[int, ...]) -> np.ndarray:
    """Distance of neighbours along x, y, z in the flat grid, int32 (3,)."""
    return np.asarray([shape[1] * shape[2], shape[2], 1], np.int32)


@refused_after_fork
def crossed_voxels(
    starts: np.ndarray,
    ends: np.ndarray,
    shape: tuple[int, int, int],
    *,
    low: np.ndarray | None = None,
    capacity: int = 0,
) -> np.ndarray:
    """Mark the voxels of a grid that rays cross, in batches.

    Args:
        starts: (n, 3) [voxel]; inside the grid.
        ends: (n, 3), likewise.
        shape: Number of voxels along x, y, z.
        low: The grid's lowest voxel, whole numbers (3,); None if places are counted from the grid's outer corner.
        capacity: Voxels of the flat grid that the kernel works on, if more than the shape needs; the same for
            all calls, they share one compiled kernel.

    Returns:
        bool (x, y, z): True where a ray crosses, starts or ends.
    """
    num_voxels = int(np.prod(shape))
    # The flat grid is padded, so that small grids of all shapes share one kernel.
    marked = jnp.zeros(max(bucket_size(num_voxels, 2**18), capacity), bool)
    for *rays, mask in ray_batches(starts, ends, low):
        marked = mark_crossed_voxels(marked, *rays, flat_strides(shape), mask)
    return np.asarray(marked)[:num_voxels].reshape(shape)


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
        max_voxels: Largest grid; None for any box, or with sensors for half as many voxels as int32 can count, because
            the kernel that casts rays works on the whole box, and pads it.
        most_dense: Larger boxes without sensors are in blocks.

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
    # Without sensors each point is a ray of no length, so that one box serves both cases.
    starts = cloud if sensor_origins is None else _checked_origins(sensor_origins, len(cloud))
    ends, is_hit = _cut_rays(starts, cloud, max_range)
    # Blocks are counted in int32, and so are the voxels that rays cross.
    most = MAX_BLOCK_VOXELS if sensor_origins is None else MAX_VOXELS // 2
    low, shape = _lattice_box(
        np.concatenate([starts, ends]), voxel_size, most if max_voxels is None else min(max_voxels, most)
    )
    if sensor_origins is None and math.prod(shape) > most_dense:
        return _sparse_states(np.floor(cloud / voxel_size).astype(np.int64) - low, shape), low * voxel_size
    _check_memory(shape, voxel_size, has_rays=sensor_origins is not None)
    # Rays first, points after them: a voxel that holds a point is occupied, whatever else crosses it.
    states = np.full(shape, UNKNOWN, np.uint8)
    if sensor_origins is not None:
        _check_steps(starts, ends, voxel_size)
        states[crossed_voxels(starts / voxel_size, ends / voxel_size, shape, low=low)] = FREE
    # Hits are divided and rounded down as the box and the rays are: none falls outside of the box, or beside its ray.
    hits = np.floor(ends[is_hit] / voxel_size).astype(np.int64) - low
    states[tuple(hits.T)] = OCCUPIED
    return states, low * voxel_size


def _sparse_states(index: np.ndarray, shape: tuple[int, int, int]) -> BlockArray:
    """States of a box in which some voxels are occupied."""
    num_blocks = count_blocks(index)
    # The list in the order of blocks, and the blocks, of which some are held twice.
    need = 32.0 * len(index) + 2.0 * BLOCK_VOXELS * num_blocks
    check_memory(need, f"a grid of {num_blocks:,} blocks of 8 x 8 x 8 voxels", _ADVICE, on_device=False)
    return blocks_with(index, OCCUPIED, shape)


def _split(places: np.ndarray, low: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Voxel index int32 from the voxel `low`, and offset float32 in [0, 1), of places [voxel]."""
    # Rounded down first and moved after: a place on a border, less a large `low`, may round into the next voxel.
    whole = np.floor(places)
    # The difference is taken in float64, and is small: rounded before, it would lose the digits that the index takes.
    offset = (places - whole).astype(np.float32)
    # As float32 an offset just below 1 is 1, which would make a step into the next voxel one of no length.
    return (whole - low).astype(np.int32), np.minimum(offset, np.nextafter(np.float32(1.0), np.float32(0.0)))


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
    check_memory(num_voxels * (5.0 if has_rays else 1.0), what, _ADVICE, on_device=has_rays)


def _check_steps(starts: np.ndarray, ends: np.ndarray, voxel_size: float, *, most: int = 1 << 18) -> None:
    """Refuse a ray [m] that crosses more than `most` voxels: all rays of a batch walk as long as its longest one."""
    longest = float(np.abs(ends - starts).sum(axis=1).max(initial=0.0)) / voxel_size
    if longest > most:
        raise InputError(
            f"a ray crosses {longest:.3g} voxels of {voxel_size:g} m, more than {most:,}; {_ADVICE}."
        )


def _lattice_box(
    places: np.ndarray, voxel_size: float, max_voxels: int
) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Lowest voxel index int64 (3,) and the shape of the smallest lattice box around places [m]."""
    # Numbers of voxels stay float64 until they are bounded: whole numbers would wrap round before that.
    low = np.floor(places.min(axis=0) / voxel_size)
    size = np.floor(places.max(axis=0) / voxel_size) - low + 1.0
    if float(np.prod(size)) > max_voxels:
        extent = " x ".join(f"{length:.4g}" for length in size * voxel_size)
        raise InputError(
            f"points span {extent} m, which is {np.prod(size):.3g} voxels of {voxel_size:g} m, above the "
            f"limit of {max_voxels:,}; {_ADVICE}."
        )
    advice = f"choose an origin near the map, or {_ADVICE}"
    check_places(places, voxel_size, advice=advice)
    return low.astype(np.int64), (int(size[0]), int(size[1]), int(size[2]))
