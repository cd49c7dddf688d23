"""What the voxels of one map meet in the other one under a pose: hits, conflicts, or nothing known."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt32

from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._runtime.pieces import PIECES
from ..._runtime.programs import kept_program
from ..._types import FREE, Array
from .lookup import Block, entries, row_entries, turn_columns, values_at
from .nearest import split_keys
from .pose_sums import pose_sums, sums_of, sums_of_piece

NOTHING = np.uint8(0)
HIT = np.uint8(1)
NEUTRAL = np.uint8(2)
CONFLICT = np.uint8(3)
_OPPOSED = np.uint8(4)
"""A hit on a surface that faces the other way."""


@refused_after_fork
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
        keys: Keys that `nearest_field` gives, in the same order.
        hit_sq: Squared distance [voxel^2] to something occupied up to which it is a hit.
        clear_sq: Squared distance [voxel^2] from which on a free voxel is well clear of anything occupied.

    Returns:
        uint8: 0 nothing known, 1 hit, 2 known but undecided, 3 conflict.
    """
    squared = split_keys(keys)[1]
    # Near something occupied any state is a hit; elsewhere only what is known to be free says anything.
    is_free = states == FREE
    code = jnp.where(is_free & (squared >= clear_sq), CONFLICT, NOTHING)
    code = jnp.where(is_free & (squared < clear_sq), NEUTRAL, code)
    return jnp.where(squared <= hit_sq, HIT, code).astype(jnp.uint8)


class SurfaceField(NamedTuple):
    """What the voxels of the other map may meet.

    Attributes:
        codes: Codes that `evidence_codes` gives, flat over the block.
        keys: Keys that `nearest_field` gives, in the same order.
        block: Place and size of the block.
        normals: Normals of the voxels that the keys point to.
        is_signed: Whether the sign of the normals means something in both maps.
    """

    codes: UInt8[Array, "flat"]
    keys: UInt32[Array, "flat"]
    block: Block
    normals: Float32[Array, "m 3"]
    is_signed: Bool[Array, ""]

    def sums(self, T: Array, points: Array, normals: Array, weights: Array) -> Float32[Array, "10"]:
        """Hits, conflicts, undecided, opposed, and xx, xy, xz, yy, yz, zz of the information; columns in."""
        # Each step is written down before the next one reads it: ten sums would look everything up ten times over.
        # Steps have one result each, for what two results share is computed twice. Normals alone are looked up where
        # they are used: there that takes less than to write down three arrays.
        is_valid = self.block.voxel_size > 0
        cell = materialized(lambda: self._cells(T, points), is_valid)
        code = materialized(lambda: self._codes_in(cell), is_valid)
        row = materialized(lambda: self._rows_hit(cell, code), is_valid)
        met = row_entries(self.normals, row)
        kind, gain = materialized(lambda: self._judged(T, code, met, normals, weights), is_valid)
        parts = [jnp.where(kind == k, weights, 0.0) for k in (HIT, CONFLICT, NEUTRAL, _OPPOSED)]
        parts += [gain * met[i] * met[j] for i in range(3) for j in range(i, 3)]
        return sums_of(parts)

    def _cells(self, T: Array, points: Array) -> Array:
        """Cells of points, -1 beyond the block."""
        cell, is_inside = self.block.cells_under(T, points)
        return jnp.where(is_inside, cell, -1)

    def _codes_in(self, cell: Array) -> Array:
        """Codes that points meet in their cells."""
        return values_at(self.codes, jnp.maximum(cell, 0), cell >= 0, NOTHING)

    def _rows_hit(self, cell: Array, code: Array) -> Array:
        """Rows of the voxels that are hit."""
        # Only a hit has a nearest voxel for sure; the others all look at one cell, which stays in the cache.
        return split_keys(entries(self.keys, jnp.where(code == HIT, cell, 0)))[0]

    def _judged(self, T: Array, code: Array, met: Sequence[Array], normals: Array, weights: Array) -> tuple:
        """Codes with hits that face the other way told apart, and what the hits weigh along the normals they met."""
        turned = turn_columns(T, normals)
        cosine = turned[0] * met[0] + turned[1] * met[1] + turned[2] * met[2]
        # Well below 0, for the normals of single voxels are biased by the grid; those of length 0 give 0 and agree.
        is_opposed = (code == HIT) & self.is_signed & (cosine < -0.3)
        is_hit = (code == HIT) & ~is_opposed
        return jnp.where(is_opposed, _OPPOSED, code), jnp.where(is_hit, weights * jnp.abs(cosine), 0.0)


class CodeField(NamedTuple):
    """Evidence codes and where they lie."""

    codes: UInt8[Array, "flat"]
    block: Block

    def sums(self, T: Array, points: Array, weights: Array) -> Float32[Array, "3"]:
        """Hits, conflicts and undecided; columns in."""
        code = materialized(
            lambda: values_at(self.codes, *self.block.cells_under(T, points), NOTHING),
            self.block.voxel_size > 0,
        )
        kinds = (HIT, CONFLICT, NEUTRAL)
        return jnp.stack([jnp.sum(jnp.where(code == k, weights, 0.0), dtype=jnp.float32) for k in kinds])


@kept_program
@jax.jit
def _surface_piece(field: SurfaceField, *piece: Array) -> Float32[Array, "p 10"]:
    return sums_of_piece(field, *piece)


@kept_program
@jax.jit
def _code_piece(field: CodeField, *piece: Array) -> Float32[Array, "p 3"]:
    return sums_of_piece(field, *piece)


@refused_after_fork
def surface_evidence(
    codes: UInt8[Array, "flat"],
    keys: UInt32[Array, "flat"],
    block: Block,
    surface_normals: Float32[Array, "m 3"],
    points: Float32[Array, "n 3"],
    normals: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    is_signed: Bool[Array, ""] | bool,
    *,
    batch_size: int = 8,
) -> tuple[Float32[Array, "k 4"], Float32[Array, "k 3 3"]]:
    """Evidence of poses in full: also which side of a surface is free, and what the hits fix.

    A hit on a surface whose free side faces the other way is no hit: a floor upon a ceiling, two sides of a wall.
    Normals of length 0 mean that the side or the direction is not known; they agree with everything.

    On a CPU the points go through in pieces of few sizes (`_runtime.pieces`), so that lists of any length and any
    number of poses compile nothing new; hand large fields over as device arrays or NumPy arrays, which are taken
    without a copy.

    Args:
        codes: Codes that `evidence_codes` gives, flat over the block; they may be longer.
        keys: Keys that `nearest_field` gives, in the same order.
        block: Place and size of the block.
        surface_normals: Normals of the voxels that the keys point to, toward free space.
        points: Points of the other map in its own frame [m].
        normals: Normals of those points.
        weights: Weight of each point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        is_signed: Whether the sign of the normals means something in both maps.
        batch_size: Poses handled together where all is one kernel: under a transformation, and not on a CPU.

    Returns:
        Sums of the weights that hit, conflict, are undecided, and meet a surface facing the other way; and the
        information of the hits, the weighted sum of `n n^T` in the frame of the block.
    """
    field = SurfaceField(codes, keys, Block.of(*block), surface_normals, jnp.asarray(is_signed, jnp.bool_))
    # What the steps of a piece of so many points write down stays in the cache of a core.
    sums = pose_sums(
        _surface_piece, field, (points, normals, weights), poses, most=8192, batch_size=batch_size
    )
    # Six sums are the upper triangle of the symmetric information.
    information = sums[:, np.asarray([4, 5, 6, 5, 7, 8, 6, 8, 9])].reshape(-1, 3, 3)
    return jax.device_put((sums[:, :4], information))


@refused_after_fork
def score_poses(
    codes: UInt8[Array, "flat"],
    block: Block,
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    *,
    batch_size: int = 8,
) -> Float32[Array, "k 3"]:
    """Weighted hits, conflicts and undecided of many poses, as `surface_evidence` but without sides.

    Args:
        codes: Codes that `evidence_codes` gives, flat in C order over the block; they may be longer.
        block: Place and size of the block.
        points: Points of the other map in its own frame [m].
        weights: Weight of each point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        batch_size: Poses handled together where all is one kernel.

    Returns:
        For each pose the sums of the weights that hit, conflict, and are known but undecided.
    """
    field = CodeField(codes, Block.of(*block))
    sums = pose_sums(_code_piece, field, (points, weights), poses, most=PIECES[-1], batch_size=batch_size)
    return jax.device_put(sums)
