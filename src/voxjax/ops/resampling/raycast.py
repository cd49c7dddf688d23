"""Ray casting on the voxel lattice: which voxels a ray crosses.

`walk_rays` is the kernel: it walks all rays in lock step from voxel to voxel, exactly. The
host functions around it cut rays into batches of similar length, so that memory is bounded and no ray waits
long for another.
"""

from collections.abc import Callable, Iterator
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32

from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._types import Array

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


def _split(places: np.ndarray, low: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Voxel index int32 from the voxel `low`, and offset float32 in [0, 1), of places [voxel]."""
    # Rounded down first and moved after: a place on a border, less a large `low`, may round into the next voxel.
    whole = np.floor(places)
    # The difference is taken in float64, and is small: rounded before, it would lose the digits that the index takes.
    offset = (places - whole).astype(np.float32)
    # As float32 an offset just below 1 is 1, which would make a step into the next voxel one of no length.
    return (whole - low).astype(np.int32), np.minimum(offset, np.nextafter(np.float32(1.0), np.float32(0.0)))
