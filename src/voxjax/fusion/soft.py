"""Soft fusion: log-odds resampled linearly between voxel centres and added, differentiable in poses and values."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._checks import InputError, check_pose
from .._runtime.placement import is_traced
from .._types import FREE, OCCUPIED, UNKNOWN, Array
from ..grid import VoxelGrid
from ..ops.resampling.interpolate import backward_affine, resample_nearest, resample_trilinear
from ..ops.resampling.lattice import moved_bounds, origin_in_voxels
from ..ops.resampling.rigid import source_from_target
from .rules import log_odds_of_states


class Lattice(NamedTuple):
    """Where a fused map lies.

    Attributes:
        origin: Outer corner (3,) [m].
        shape: Number of voxels along x, y, z.
        voxel_size: Edge length of a voxel [m].
    """

    origin: np.ndarray
    shape: tuple[int, int, int]
    voxel_size: float


def fuse_soft(
    grids: Sequence[VoxelGrid], poses: Sequence[Float[Array, "4 4"]], target: Lattice
) -> tuple[jax.Array, jax.Array]:
    """Add the log-odds of maps, each looked up backward and linear between the eight nearest centres.

    Differentiable, forward and reverse, in each pose (but where a centre crosses from one cell to the next: there the
    derivative jumps, the values do not) and in each map's log-odds. A gradient takes about 100 bytes for each voxel of
    the target and map. States, origins and voxel sizes are concrete numbers.

    What is not known counts as 0, inside a map as beyond its border: log-odds fade to 0 within one voxel of what is
    known. That weakens them there but never turns their sign, so no surface moves. A voxel is known if the nearest
    voxel of any map is, as in fusion without interpolation; where the fading reaches farther, it stays unknown.

    Args:
        grids: Maps; those without log-odds count as one observation a voxel. Log-odds may be traced, and float64.
        poses: `T_target_map` of each, rigid; may be traced.
        target: Where the result lies.

    Returns:
        States uint8, and the sum of log-odds in the widest dtype of traced poses and log-odds, not limited to OctoMap's
        range, where it would have no gradient. Both (x, y, z).
    """
    values = [_known_log_odds(grid) for grid in grids]
    # Concrete poses are float64 for the sake of accuracy, and must not make all arrays as wide.
    dtype = np.result_type(*(v.dtype for v in values), *(T.dtype for T in poses if is_traced(T)))
    total = jnp.zeros(target.shape, dtype)
    is_known = jnp.zeros(target.shape, bool)
    for grid, log_odds, T in zip(grids, values, poses, strict=True):
        start, stop = _reached(grid, T, target)
        if (stop <= start).any():  # the map reaches no voxel of the target, or knows nothing
            continue
        affine = _affine(grid, T, target, start, dtype)
        window = tuple(slice(int(low), int(high)) for low, high in zip(start, stop, strict=True))
        shape = tuple((stop - start).tolist())
        resampled = resample_trilinear(log_odds.astype(dtype), affine, target_shape=shape)
        total = total.at[window].add(resampled)
        nearest = resample_nearest(jnp.asarray(grid.states), affine, target_shape=shape)
        is_known = is_known.at[window].set(is_known[window] | (nearest != UNKNOWN))
    # States have no derivative, so they may follow the nearest voxel while the sum is interpolated.
    known_state = jnp.where(total >= jnp.zeros((), dtype), OCCUPIED, FREE)
    return jnp.where(is_known, known_state, UNKNOWN), total


def soft_fuse_memory(num_fused: int, num_voxels: Sequence[int], *, fixed: float = 0.2e9) -> float:
    """Estimated peak beside the maps themselves and the running process, without gradients [byte].

    Args:
        num_fused: Voxels of the fused map: sum, resampled log-odds, a copy of one of them, states and masks.
        num_voxels: Voxels of each map: log-odds where it is known.
        fixed: What any fusion takes: compiled kernels [byte].
    """
    return fixed + 16.0 * num_fused + 9.0 * sum(num_voxels)


def check_soft_pose(name: str, T: Any) -> Array:
    """Return a pose as it is if traced, else checked, float64.

    Raises:
        InputError: If a concrete pose is not rigid, or a traced one no floating (4, 4).
    """
    if not is_traced(T):
        check_pose(name, T)
        return np.asarray(T, np.float64)
    if T.shape != (4, 4) or not jnp.issubdtype(T.dtype, jnp.floating):
        raise InputError(
            f"{name} must be a (4, 4) matrix of floating numbers, got {T.dtype} of shape {T.shape}."
        )
    return T


def _known_log_odds(grid: VoxelGrid) -> jax.Array:
    """Log-odds (x, y, z), 0 where the map knows nothing, so that they add nothing."""
    states = jnp.asarray(grid.states)
    if grid.log_odds is None:
        return log_odds_of_states(states)
    log_odds = jnp.asarray(grid.log_odds)
    return jnp.where(states != UNKNOWN, log_odds, jnp.zeros((), log_odds.dtype))


def _reached(grid: VoxelGrid, T: Array, target: Lattice) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last voxel of the target that a map may reach; all of them for a traced pose."""
    shape = np.asarray(target.shape, np.int64)
    if is_traced(T):
        return np.zeros(3, np.int64), shape
    states, origin = np.asarray(grid.states), np.asarray(grid.origin)
    low, high = moved_bounds(states, origin, grid.voxel_size, np.asarray(T), target.voxel_size)
    if (high <= low).any():
        return shape, shape
    base = origin_in_voxels(target.origin, target.voxel_size)
    # Interpolation fades over one voxel of the map in any direction; its diagonal is sqrt(3), less than 1.8.
    fade = 2 + int(np.ceil(1.8 * grid.voxel_size / target.voxel_size))
    start, stop = np.floor(low - base).astype(np.int64) - fade, np.ceil(high - base).astype(np.int64) + fade
    return np.clip(start, 0, shape), np.clip(stop, 0, shape)


def _affine(grid: VoxelGrid, T: Array, target: Lattice, start: np.ndarray, dtype: np.dtype) -> Array:
    """From voxels of the target, counted from `start`, to those of the map."""
    origin = np.asarray(grid.origin)
    # A concrete pose takes the matrix of nearest fusion, made in float64, so that both look up the same voxels. A pose
    # that is traced needs a form that JAX can differentiate.
    if not is_traced(T) and dtype == np.float32:
        cell = origin_in_voxels(target.origin, target.voxel_size) + start
        return source_from_target(np.asarray(T), origin, grid.voxel_size, cell, target.voxel_size)
    corner = np.asarray(target.origin, np.float64) + start * target.voxel_size
    pose, source, corner = (jnp.asarray(value, dtype) for value in (T, origin, corner))
    return backward_affine(pose, source, grid.voxel_size, corner, target.voxel_size)
