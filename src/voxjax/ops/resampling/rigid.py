"""Rigid resampling of grids by backward lookup: each target voxel asks where its centre came from.

Forward moves would leave holes; backward lookup cannot. It goes block by block, see `block_lookup`, so that maps of any
size share a few compiled programs, and time and memory follow what is known. For whole grids under jit, vmap and grad
see `interpolate`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Float64, Shaped, UInt8

from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory
from ...frames import snapped, to_local
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.block_builder import BlockBuilder, blocks_of
from ..blocks.windows import cut_tiles
from ..blocks.words import BLOCK
from .block_lookup import LEVEL, MIXED, MovedBlocks, check_target, runs
from .lattice import (
    about_middle,
    cell_of_image,
    check_num_voxels,
    moved_bounds,
    origin_in_voxels,
    origin_of_cell,
)

_WHAT, _ADVICE = "the moved map", "crop it to its known part or coarsen it first"


def source_from_target(
    T: Float[np.ndarray, "4 4"],
    source_origin: Float[np.ndarray, "3"],
    source_voxel_size: float,
    target_cell: Shaped[np.ndarray, "3"],
    target_voxel_size: float,
) -> Float32[np.ndarray, "3 4"]:
    """Affine map from coordinates of target voxels to those of source voxels, for a source moved by `T`.

    Both count voxels from the outer corner of their grid. Computed in float64, and small numbers by the time they are
    rounded to float32.
    """
    matrix = np.asarray(T, np.float64)
    inverse = matrix[:3, :3].T
    scale = target_voxel_size / source_voxel_size
    corner = np.asarray(target_cell, np.float64) * target_voxel_size - matrix[:3, 3]
    offset = inverse @ corner / source_voxel_size - origin_in_voxels(source_origin, source_voxel_size)
    return np.concatenate([inverse * scale, offset[:, None]], axis=1).astype(np.float32)


@refused_after_fork
def resample_rigid(
    states: UInt8[np.ndarray, "x y z"],
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    T: Float[np.ndarray, "4 4"],
    log_odds: Float32[np.ndarray, "x y z"] | None = None,
) -> tuple[UInt8[np.ndarray, "u v w"], Float64[np.ndarray, "3"], Float32[np.ndarray, "u v w"] | None]:
    """Move a grid by a rigid transform and resample it on the lattice of multiples of its voxel size.

    States and log-odds come from the nearest voxel. The 24 rotations of the cube with whole-voxel
    translations are exact.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the voxels of grid and result [m].
        T: Pose that moves the grid.
        log_odds: Or None.

    Returns:
        States, origin and log-odds (None if not given); one unknown voxel when nothing is known and `T` is
        no rotation of the cube.

    Raises:
        InputError: If the result would have more than 2**31 - 1 voxels, or needs more memory than there is.
    """
    target = _target(states, origin, voxel_size, T)
    check_num_voxels(np.asarray(target.shape), _WHAT, _ADVICE)
    kept = [states] if log_odds is None else [states, log_odds]
    # The result, the blocks of both, and what these are put together from.
    num_bytes = 1 if log_odds is None else 5
    check_memory(num_bytes * (2.0 * float(np.prod(target.shape)) + 3.0 * states.size), _WHAT, _ADVICE)
    found = [moved.dense() for moved in _moved([blocks_of(values) for values in kept], target)]
    return np.asarray(found[0]), target.origin, None if log_odds is None else np.asarray(found[1])


@refused_after_fork
def resample_blocks(
    states: BlockArray,
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    T: Float[np.ndarray, "4 4"],
    log_odds: BlockArray | None = None,
) -> tuple[BlockArray, Float64[np.ndarray, "3"], BlockArray | None]:
    """Move a grid in blocks as `resample_rigid` does with a dense one; the box may be of any size.

    Args:
        states: uint8 (x, y, z): 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the voxels of grid and result [m].
        T: Pose that moves the grid.
        log_odds: float32, or None.

    Returns:
        States, origin and log-odds (None if not given).

    Raises:
        InputError: If the result reaches farther than its voxels can be placed, or needs more memory than there is.
    """
    target = _target(states, origin, voxel_size, T)
    arrays = [states] if log_odds is None else [states, log_odds]
    # A block that is turned meets two or three of the target; they are put together from pieces.
    num_bytes = sum(np.count_nonzero(~v.is_uniform) * float(v.dtype.itemsize) * BLOCK_VOXELS for v in arrays)
    check_memory(6.0 * num_bytes, _WHAT, _ADVICE)
    found = _moved(arrays, target)
    return found[0], target.origin, None if log_odds is None else found[1]


class _Target(NamedTuple):
    """Where a moved grid lies: its outer corner [m], number of voxels, and the map back to voxels of the source."""

    origin: Float64[np.ndarray, "3"]
    shape: tuple[int, int, int]
    affine: Float32[np.ndarray, "3 4"]


def _target(
    states: np.ndarray | BlockArray, origin: np.ndarray, voxel_size: float, T: Float[np.ndarray, "4 4"]
) -> _Target:
    """Where a grid lies after it has been moved by `T`.

    Raises:
        InputError: If it reaches farther than its voxels can be placed.
    """
    # Bounds and lookups are worked out where numbers are small, and the result is put back by whole cells.
    origin, place = about_middle(origin, states.shape, voxel_size)
    zero = cell_of_image(T, place, voxel_size)
    T = snapped(to_local(T, origin_of_cell(zero, voxel_size), place), voxel_size)
    low, high = moved_bounds(states, origin, voxel_size, T, voxel_size)
    # Where nothing is known, both bounds are one, and a single unknown voxel stands for it.
    x, y, z = np.maximum(high - low, 1).tolist()
    check_target((x, y, z), _WHAT, _ADVICE)
    affine = source_from_target(T, origin, voxel_size, low, voxel_size)
    return _Target(origin_of_cell(low + zero, voxel_size), (x, y, z), affine)


def _moved(arrays: Sequence[BlockArray], target: _Target) -> list[BlockArray]:
    """The arrays looked up in the target, window by window."""
    builders = [BlockBuilder(target.shape, array.dtype) for array in arrays]
    source = MovedBlocks(tuple(arrays), target.affine)
    for tile in cut_tiles(target.shape, halo=0, most=1 << 23):
        low, high = tile.low // BLOCK, -(-tile.high // BLOCK)
        if not source.holds_any(low, high):
            continue
        kind = source.survey(low, high).kind
        level, mixed = low + np.argwhere(kind == LEVEL), low + np.argwhere(kind == MIXED)
        for builder, values in zip(builders, source.middles(level), strict=True):
            builder.put(level, values)
        look_up = source.look_up(mixed)
        for part, length in runs(len(mixed)):
            for builder, values in zip(builders, look_up(part, length), strict=True):
                blocks = np.asarray(values)[: part.stop - part.start]
                builder.add(mixed[part], blocks.reshape(-1, BLOCK, BLOCK, BLOCK))
    return [builder.finish() for builder in builders]
