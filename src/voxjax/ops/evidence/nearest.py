"""Nearest occupied voxel, up to a radius, for every voxel of a block, axis by axis.

The field is flat, so that one compiled kernel serves every grid whose volume falls on the same rung.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int32, UInt32

from ..._checks import InputError
from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._runtime.tables import check_cells
from ..._types import Array
from .lookup import entries

INDEX_BITS = 26
"""A key is `squared distance << 26 | index`: 67 million voxels, squared distances below 63."""

NOTHING_NEAR = np.uint32(0xFFFFFFFF)


@refused_after_fork
@partial(jax.jit, static_argnames=("flat_size", "radius"))
def nearest_field(
    index: Int32[Array, "n 3"],
    mask: Bool[Array, "n"],
    dims: Int32[Array, "3"],
    *,
    flat_size: int,
    radius: int,
) -> UInt32[Array, "flat_size"]:
    """Key of the nearest listed voxel for every voxel of a block, exact up to `radius`.

    Ties go to the voxel listed first. Equals a brute-force search; see `tests/ops/evidence/test_nearest.py`.

    Args:
        index: Listed (occupied) voxels inside the block.
        mask: False for padding rows.
        dims: Size of the block [voxel]; traced, so that it costs no compilation.
        flat_size: Length of the result, at least `prod(dims)`.
        radius: Reach [voxel], 1 to 7.

    Returns:
        `squared distance << 26 | row of index`, or `NOTHING_NEAR`; C order over `dims`.

    Raises:
        InputError: If the radius or the number of rows does not fit the key, or the field is too long for int32.
    """
    # Its square must fit the six bits of a key.
    max_radius = 7
    if not 1 <= radius <= max_radius:
        raise InputError(f"radius must be 1 to {max_radius} voxels, got {radius}.")
    if index.shape[0] >= 1 << INDEX_BITS:
        raise InputError(f"index must list fewer than {1 << INDEX_BITS} voxels, got {index.shape[0]}.")
    check_cells(flat_size, 0, "a field", "take a larger voxel size, or work tile by tile")
    row = jnp.arange(index.shape[0], dtype=jnp.uint32)
    strides = jnp.stack([dims[1] * dims[2], dims[2], jnp.ones_like(dims[2])])
    # A voxel outside of the block would have the flat place of another one inside.
    is_inside = mask & jnp.all((index >= 0) & (index < dims[None, :]), axis=1)
    flat = jnp.where(is_inside, jnp.sum(index * strides[None, :], axis=1, dtype=jnp.int32), flat_size)
    # Rows outside and padding write past the end, which is dropped; of rows with one voxel the first one stays.
    field = jnp.full((flat_size,), NOTHING_NEAR, dtype=jnp.uint32).at[flat].min(row, mode="drop")
    for axis in range(3):
        field = _spread_along(field, strides[axis], dims[axis], radius)
    return field


def nearest_rows(
    keys: UInt32[Array, "flat"],
    cells: Callable[[], tuple[Array, Array]],
    is_valid: Bool[Array, ""] | np.bool_ | bool,
) -> tuple[Bool[Array, "n"], Int32[Array, "n"]]:
    """Whether a listed voxel is in reach of points, and its row, 0 where there is none.

    Args:
        keys: Field that `nearest_field` gives.
        cells: Function that gives the cells of the points and whether they are inside the block.
        is_valid: Condition that always holds but that a compiler cannot know, see `materialized`.
    """

    def look() -> tuple[Array, Array]:
        cell, is_inside = cells()
        key = entries(keys, cell)
        is_near = is_inside & (key != NOTHING_NEAR)
        return is_near, jnp.where(is_near, split_keys(key)[0], 0)

    return materialized(look, is_valid)


def _spread_along(field: Array, stride: Array, size: Array, radius: int) -> Array:
    """Least key along one axis, the squared step added: squared distances are sums over the axes.

    Keys farther than the radius are dropped at once, so that no sum leaves its six bits.
    """
    # Cells past the volume have places as well, from 0 on again: so no step crosses the border between them and it.
    place = jnp.arange(field.shape[0], dtype=jnp.int32) // stride % size
    # Twice in a row: a shift by a stride that is known at run time only is one slice of it. What comes from beyond the
    # axis is told by its place.
    twice = jnp.concatenate([field, field])

    def take_step(step: Array, best: Array) -> Array:
        # Steps read the field as the axis found it, and not what other steps have made of it: each
        # squared step is added once.
        squared = (step * step).astype(jnp.uint32)
        for sign in (1, -1):
            # The remainder is never negative, so that a step back is a slice from further on in the doubled field.
            start = (sign * step * stride) % field.shape[0]
            other = jax.lax.dynamic_slice(twice, (start,), field.shape)
            at = place + sign * step
            # The 63 of nothing near is more than the square of any radius, so its key, which wraps round
            # in the sum, is not taken.
            is_near = (other >> np.uint32(INDEX_BITS)) + squared <= np.uint32(radius * radius)
            key = other + (squared << np.uint32(INDEX_BITS))
            best = jnp.minimum(best, jnp.where((at >= 0) & (at < size) & is_near, key, NOTHING_NEAR))
        return best

    # A loop, not unrolled: one kernel of all steps runs six times slower on a CPU.
    return jax.lax.fori_loop(1, radius + 1, take_step, field)


@refused_after_fork
def split_keys(keys: UInt32[Array, "*n"]) -> tuple[Int32[Array, "*n"], Int32[Array, "*n"]]:
    """Row of the nearest voxel and its squared distance [voxel^2] (63 where nothing is near)."""
    mask = np.uint32((1 << INDEX_BITS) - 1)
    return (keys & mask).astype(jnp.int32), (keys >> np.uint32(INDEX_BITS)).astype(jnp.int32)
