"""What the voxels of one map meet in the other one under a pose: hits, conflicts, or nothing known."""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt32

from .._types import FREE, Array
from .nearest import NOTHING_NEAR, split_keys

NOTHING = np.uint8(0)
HIT = np.uint8(1)
NEUTRAL = np.uint8(2)
CONFLICT = np.uint8(3)


@jax.jit
def evidence_codes(
    states: UInt8[Array, "n"],
    keys: UInt32[Array, "n"],
    hit_sq: Int32[Array, ""] | int,
    clear_sq: Int32[Array, ""] | int,
) -> UInt8[Array, "n"]:
    """Say for each voxel what an occupied voxel of the other map would mean there.

    Args:
        states: Flat states of the map, 0 unknown, 1 free, 2 occupied.
        keys: Of `nearest_field`, same order.
        hit_sq: Squared distance [voxel^2] to something occupied up to which it is a hit.
        clear_sq: Squared distance [voxel^2] from which on a free voxel is well clear of anything occupied.

    Returns:
        uint8: 0 nothing known, 1 hit, 2 known but undecided, 3 conflict.
    """
    squared = split_keys(keys)[1]
    is_free = states == FREE
    code = jnp.where(is_free & (squared >= clear_sq), CONFLICT, NOTHING)
    code = jnp.where(is_free & (squared < clear_sq), NEUTRAL, code)
    return jnp.where(squared <= hit_sq, HIT, code).astype(jnp.uint8)


def lookup(
    field: Array,
    dims: Int32[Array, "3"],
    origin: Float32[Array, "3"],
    voxel_size: Float32[Array, ""],
    points: Float32[Array, "*n 3"],
    outside: np.generic,
) -> Array:
    """Value of a flat field at points [m]; `outside` beyond the block."""
    cell, is_inside = _cells(dims, origin, voxel_size, [points[..., axis] for axis in range(3)])
    return _values(field, cell, is_inside, outside)


def _cells(dims: Array, origin: Array, voxel_size: Array, at: Sequence[Array]) -> tuple[Array, Array]:
    """Cell of a flat field at x, y and z [m], 0 beyond the block; and whether it lies inside."""
    # Axis by axis: arrays whose last axis is 3 run ten times slower on a CPU.
    x, y, z = (jnp.floor((at[axis] - origin[axis]) / voxel_size).astype(jnp.int32) for axis in range(3))
    is_inside = (x >= 0) & (x < dims[0]) & (y >= 0) & (y < dims[1]) & (z >= 0) & (z < dims[2])
    return jnp.where(is_inside, (x * dims[1] + y) * dims[2] + z, 0), is_inside


def _values(field: Array, cell: Array, is_inside: Array, outside: np.generic) -> Array:
    return jnp.where(is_inside, jnp.take(field, cell, mode="clip"), jnp.asarray(outside, field.dtype))


def _turned(rotation: Array, columns: Array) -> list[Array]:
    """Vectors as rows x, y and z, turned."""
    x, y, z = columns
    return [rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3)]


@partial(jax.jit, static_argnames=("batch_size",))
def surface_evidence(
    codes: UInt8[Array, "flat"],
    keys: UInt32[Array, "flat"],
    dims: Int32[Array, "3"],
    origin: Float32[Array, "3"],
    voxel_size: Float32[Array, ""],
    surface_normals: Float32[Array, "m 3"],
    points: Float32[Array, "n 3"],
    normals: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    is_signed: Bool[Array, ""] | bool,
    *,
    batch_size: int = 2,
) -> tuple[Float32[Array, "k 4"], Float32[Array, "k 3 3"]]:
    """Evidence of few poses in full: also which side of a surface is free, and what the hits fix.

    A hit on a surface whose free side faces the other way is no hit: a floor upon a ceiling, two sides of a wall.
    Normals of length 0 mean that the side or the direction is not known; they agree with everything.

    Args:
        codes: Of `evidence_codes`, flat over `dims`.
        keys: Of `nearest_field`, same order.
        dims: Size of the block [voxel].
        origin: Its outer corner [m].
        voxel_size: [m].
        surface_normals: Normals of the voxels that the keys point to, toward free space.
        points: Points of the other map in its own frame [m].
        normals: Their normals.
        weights: One a point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        is_signed: Whether the sign of the normals means something in both maps.
        batch_size: Poses handled together.

    Returns:
        Sums of the weights that hit, conflict, are undecided, and meet a surface facing the other way; and the
        information of the hits, the weighted sum of `n n^T` in the frame of the block.
    """
    point_columns, normal_columns, surface_columns = points.T, normals.T, surface_normals.T

    def judge(T: Array) -> tuple[Array, Array]:
        moved = [c + T[i, 3] for i, c in enumerate(_turned(T, point_columns))]
        cell, is_inside = _cells(dims, origin, voxel_size, moved)
        code = _values(codes, cell, is_inside, NOTHING)
        row = split_keys(_values(keys, cell, is_inside, NOTHING_NEAR))[0] % surface_normals.shape[0]
        met = [jnp.take(c, row, mode="clip") for c in surface_columns]
        turned = _turned(T, normal_columns)
        cosine = turned[0] * met[0] + turned[1] * met[1] + turned[2] * met[2]
        is_opposed = (code == HIT) & is_signed & (cosine < -0.3)
        is_hit = (code == HIT) & ~is_opposed
        kinds = [is_hit, code == CONFLICT, code == NEUTRAL, is_opposed]
        sums = jnp.stack([jnp.sum(jnp.where(k, weights, 0.0), dtype=jnp.float32) for k in kinds])
        gain = jnp.where(is_hit, weights * jnp.abs(cosine), 0.0)
        products = [jnp.sum(gain * met[i] * met[j], dtype=jnp.float32) for i in range(3) for j in range(3)]
        return sums, jnp.stack(products).reshape(3, 3)

    return jax.lax.map(judge, poses, batch_size=batch_size)


@partial(jax.jit, static_argnames=("batch_size",))
def score_poses(
    codes: UInt8[Array, "flat"],
    dims: Int32[Array, "3"],
    origin: Float32[Array, "3"],
    voxel_size: Float32[Array, ""],
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    *,
    batch_size: int = 8,
) -> Float32[Array, "k 3"]:
    """Weighted hits, conflicts and undecided of many poses; memory grows with `batch_size * n` only.

    Args:
        codes: Of `evidence_codes`, flat in C order over `dims`.
        dims: Size of the block [voxel].
        origin: Outer corner of the block [m].
        voxel_size: [m].
        points: Points of the other map in its own frame [m].
        weights: One a point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        batch_size: Poses handled together.

    Returns:
        For each pose the sums of the weights that hit, conflict, and are known but undecided.
    """
    columns = points.T

    def score(T: Array) -> Array:
        moved = [c + T[i, 3] for i, c in enumerate(_turned(T, columns))]
        code = _values(codes, *_cells(dims, origin, voxel_size, moved), NOTHING)
        sums = [
            jnp.sum(jnp.where(code == c, weights, 0.0), dtype=jnp.float32) for c in (HIT, CONFLICT, NEUTRAL)
        ]
        return jnp.stack(sums)

    return jax.lax.map(score, poses, batch_size=batch_size)
