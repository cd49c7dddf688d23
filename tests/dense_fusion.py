"""Fusion and rigid resampling over all voxels of the box, as a twin of those that go block by block.

Places are those of the definition in float32, looked up in runs of flat indices; bounds, poses in local frames and
rules are the library's own, each of which has tests of its own.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from voxjax import VoxelGrid
from voxjax.frames import snapped, to_local
from voxjax.fusion.rules import fuse_keep, fuse_log_odds, fuse_paper, log_odds_of_states
from voxjax.ops.resampling.lattice import about_middle, cell_of_image, moved_bounds, origin_of_cell
from voxjax.ops.resampling.rigid import source_from_target


@functools.partial(jax.jit, static_argnames=("size",))
def places_of_run(source_shape, affine, target_shape, start, *, size):
    """Flat source index of the nearest voxel for a run of flat target indices, and whether there is one."""
    flat = jnp.minimum(start + jnp.arange(size, dtype=jnp.int32), jnp.prod(target_shape, dtype=jnp.int32) - 1)
    row = jax.lax.div(flat, jnp.full_like(flat, target_shape[2]))
    x = jax.lax.div(row, jnp.full_like(row, target_shape[1]))
    y, z = row - x * target_shape[1], flat - row * target_shape[2]
    centre = [axis.astype(jnp.float32) + jnp.float32(0.5) for axis in (x, y, z)]
    m = affine
    at = [m[a, 0] * centre[0] + m[a, 1] * centre[1] + m[a, 2] * centre[2] + m[a, 3] for a in range(3)]
    i, j, k = (jnp.floor(axis + 1e-3).astype(jnp.int32) for axis in at)
    is_inside = jnp.ones(i.shape, bool)
    for axis, side in ((i, source_shape[0]), (j, source_shape[1]), (k, source_shape[2])):
        is_inside = is_inside & (axis >= 0) & (axis < side)
    return jnp.where(is_inside, (i * source_shape[1] + j) * source_shape[2] + k, 0), is_inside


def lookup(values, affine, shape):
    """Values of all voxels of a target, 0 beyond the source, and whether they lie in it."""
    num_voxels = int(np.prod(shape))
    size = min(1 << 20, 1 << max(int(num_voxels - 1).bit_length(), 12))
    index, is_inside = [], []
    shapes = np.asarray(values[0].shape, np.int32), np.asarray(shape, np.int32)
    for start in range(0, num_voxels, size):
        run = places_of_run(shapes[0], affine, shapes[1], np.int32(start), size=size)
        index.append(np.asarray(run[0]))
        is_inside.append(np.asarray(run[1]))
    index, is_inside = (np.concatenate(each)[:num_voxels].reshape(shape) for each in (index, is_inside))
    return [np.where(is_inside, v.reshape(-1)[index], v.dtype.type(0)) for v in values], is_inside


def fuse(grids, poses, *, rule, voxel_size):
    """`vx.fuse` of maps in the order in which their log-odds are to be added, none without a known voxel."""
    coarse = [g if g.voxel_size >= voxel_size else g.with_voxel_size(voxel_size) for g in grids]
    local, places = zip(*(grid.localized() for grid in coarse), strict=True)
    zero = np.min([cell_of_image(T, p, voxel_size) for T, p in zip(poses, places, strict=True)], axis=0)
    origin = origin_of_cell(zero, voxel_size)
    poses = [snapped(to_local(T, origin, p), voxel_size) for T, p in zip(poses, places, strict=True)]
    bounds = [
        moved_bounds(np.asarray(g.states), np.asarray(g.origin), g.voxel_size, T, voxel_size)
        for g, T in zip(local, poses, strict=True)
    ]
    low = np.min([first for first, _ in bounds], axis=0)
    shape = tuple((np.max([end for _, end in bounds], axis=0) - low).tolist())
    states, covered, odds = [], [], []
    for grid, T in zip(local, poses, strict=True):
        affine = source_from_target(T, np.asarray(grid.origin), grid.voxel_size, low, voxel_size)
        values = [np.asarray(grid.states)]
        if rule == "log_odds" and grid.log_odds is not None:
            values.append(np.asarray(grid.log_odds))
        found, is_inside = lookup(values, affine, shape)
        states.append(found[0])
        covered.append(is_inside)
        odds.append(found[1] if len(found) > 1 else np.asarray(log_odds_of_states(found[0])))
    fused_odds = None
    if rule == "paper":
        fused = fuse_paper(np.stack(states), np.stack(covered))
    elif rule == "keep":
        fused = fuse_keep(np.stack(states))
    else:
        fused, fused_odds = fuse_log_odds(np.stack(states), np.stack(odds))
    return VoxelGrid(np.asarray(fused), origin_of_cell(low + zero, voxel_size), voxel_size, fused_odds)


def transformed(grid, T):
    """`VoxelGrid.transformed`."""
    size, states = grid.voxel_size, np.asarray(grid.states)
    origin, place = about_middle(np.asarray(grid.origin), grid.shape, size)
    zero = cell_of_image(T, place, size)
    T = snapped(to_local(T, origin_of_cell(zero, size), place), size)
    low, high = moved_bounds(states, origin, size, T, size)
    shape = tuple(np.maximum(high - low, 1).tolist())
    values = [states] if grid.log_odds is None else [states, np.asarray(grid.log_odds)]
    found, _ = lookup(values, source_from_target(T, origin, size, low, size), shape)
    return VoxelGrid(found[0], origin_of_cell(low + zero, size), size, *found[1:])
