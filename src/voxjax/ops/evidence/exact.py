"""How exactly surfaces of two maps lie on each other under a pose: what a chance agreement does not reach.

Of thousands of wrong poses some bring many voxels near each other, but these lie within the tolerance of a hit at any
distance and at any angle. Under a right pose most of them lie on one plane, as exactly as the maps are.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float32, UInt8, UInt32

from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._runtime.programs import kept_program
from ..._types import Array
from .lookup import Block, entries, row_entries, turn_columns, values_at
from .nearest import split_keys
from .pose_sums import pose_sums, sums_of, sums_of_piece
from .scoring import HIT, NOTHING


class ExactField(NamedTuple):
    """Surface of a map that planes of the other map may lie on.

    Attributes:
        codes: Codes that `evidence_codes` gives, flat over the block.
        keys: Keys that `nearest_field` gives, in the same order.
        block: Place and size of the block.
        anchors: Places [m] on the planes through the voxels that the keys point to.
        normals: Normals of these voxels, of length 0 where there is no plane.
        is_signed: Whether the sign of the normals means something in both maps.
        reach: Distance [m] from the plane up to which a point lies on it.
        min_cosine: Least cosine between the normals of two planes that are one.
    """

    codes: UInt8[Array, "flat"]
    keys: UInt32[Array, "flat"]
    block: Block
    anchors: Float32[Array, "m 3"]
    normals: Float32[Array, "m 3"]
    is_signed: Bool[Array, ""]
    reach: Float32[Array, ""]
    min_cosine: Float32[Array, ""]

    def sums(self, T: Array, *columns: Array) -> Float32[Array, "6"]:
        """xx, xy, xz, yy, yz, zz of the information; columns of anchors, normals and weights in."""
        anchors, normals, weights = columns
        is_valid = self.block.voxel_size > 0
        row, is_hit = materialized(lambda: self._rows_hit(T, anchors), is_valid)
        met = row_entries(self.normals, row)
        places = [place + T[i, 3] for i, place in enumerate(turn_columns(T[:3, :3], anchors))]
        plane = row_entries(self.anchors, row)
        turned = turn_columns(T[:3, :3], normals)
        distance = sum((places[i] - plane[i]) * met[i] for i in range(3))
        cosine = sum(turned[i] * met[i] for i in range(3))
        cosine = jnp.where(self.is_signed, cosine, jnp.abs(cosine))
        is_exact = is_hit & (jnp.abs(distance) <= self.reach) & (cosine >= self.min_cosine)
        gain = materialized(lambda: jnp.where(is_exact, weights, 0.0), is_valid)
        return sums_of([gain * met[i] * met[j] for i in range(3) for j in range(i, 3)])

    def _rows_hit(self, T: Array, points: Array) -> tuple[Array, Array]:
        """Rows of the nearest voxels of points, 0 where they are no hits, and whether they are."""
        cell, is_inside = self.block.cells_under(T, points)
        is_hit = values_at(self.codes, cell, is_inside, NOTHING) == HIT
        return split_keys(entries(self.keys, jnp.where(is_hit, cell, 0)))[0], is_hit


@kept_program
@jax.jit
def _exact_piece(field: ExactField, *piece: Array) -> Float32[Array, "p 6"]:
    return sums_of_piece(field, *piece)


@refused_after_fork
def exact_information(
    codes: UInt8[Array, "flat"],
    keys: UInt32[Array, "flat"],
    block: Block,
    surface_anchors: Float32[Array, "m 3"],
    surface_normals: Float32[Array, "m 3"],
    anchors: Float32[Array, "n 3"],
    normals: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    is_signed: Bool[Array, ""] | bool,
    *,
    reach: Float32[Array, ""] | float,
    min_cosine: Float32[Array, ""] | float = 0.9,
    batch_size: int = 8,
) -> Float32[Array, "k 3 3"]:
    """Information of the points that lie exactly on a plane of the other map, under each of some poses.

    A point counts where it hits (`evidence_codes`), lies within `reach` of the plane through the nearest voxel, and
    both planes are turned alike. Points and voxels without a plane do not count.

    Args:
        codes: Codes that `evidence_codes` gives, flat over the block; they may be longer.
        keys: Keys that `nearest_field` gives, in the same order.
        block: Place and size of the block.
        surface_anchors: Places [m] on the planes through the voxels that the keys point to.
        surface_normals: Unit normals of these voxels, toward free space; rows of 0 where there is no plane.
        anchors: Places on the planes of the other map in its own frame [m].
        normals: Unit normals there, rows of 0 where there is no plane.
        weights: Weight of each point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        is_signed: Whether the sign of the normals means something in both maps.
        reach: Distance [m] from a plane up to which a point lies on it.
        min_cosine: Least cosine between the normals of two planes that are one.
        batch_size: Poses handled together where all is one kernel: under a transformation, and not on a CPU.

    Returns:
        The weighted sum of `n n^T` over these points, n the normal that each met, in the frame of the block.
    """
    bounds = (jnp.asarray(value, jnp.float32) for value in (reach, min_cosine))
    is_signed = jnp.asarray(is_signed, jnp.bool_)
    field = ExactField(codes, keys, Block.of(*block), surface_anchors, surface_normals, is_signed, *bounds)
    lists = (anchors, normals, weights)
    sums = pose_sums(_exact_piece, field, lists, poses, most=8192, batch_size=batch_size)
    # Six sums are the upper triangle of the symmetric information.
    return jax.device_put(sums[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))
