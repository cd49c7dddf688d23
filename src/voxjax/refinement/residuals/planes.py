"""Points of one map against the planes around the surface voxels of another (point to plane)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int32, UInt32

from ... import rigid
from ..._runtime.materialize import materialized
from ..._types import Array
from ...ops.evidence.lookup import Block, entries, row_entries, turn_columns
from ...ops.evidence.nearest import nearest_rows
from .losses import Loss
from .terms import Columns, Level, PointTerm, Term, dot, moved_columns

SLIDE_WEIGHT = 0.1
"""How much a distance along the surface counts beside one across it: the grid rounds the former."""


MIN_PLANARITY = 0.3
"""Below it a normal says nothing about the side."""


class NearestSurface(NamedTuple):
    """Occupied voxels of map a and the field that finds the nearest of them.

    Attributes:
        keys: Flat field of `ops.evidence.nearest.nearest_field`.
        dims: Size of its block [voxel].
        origin: Outer corner of that block [m].
        voxel_size: Edge length of its voxels [m].
        points: Places on the planes around the voxels that the keys point to [m].
        normals: Unit normals there.
        planarity: How far to trust the normals, in [0, 1].
        is_signed: Whether the normals of both maps point to free space, so that two sides of a wall differ.
        trust: Factor on the weight of a point that meets the voxel, at least 0; None for 1.
        table: Rows of the keys by blocks, see `Block`; None for a dense field.
    """

    keys: UInt32[Array, "flat"]
    dims: Int32[Array, "3"]
    origin: Float[Array, "3"]
    voxel_size: Float[Array, ""]
    points: Float[Array, "m 3"]
    normals: Float[Array, "m 3"]
    planarity: Float[Array, "m"]
    is_signed: Bool[Array, ""]
    trust: Float[Array, "m"] | None = None
    table: Int32[Array, "blocks"] | None = None

    @property
    def block(self) -> Block:
        """Where the keys lie."""
        return Block(self.dims, self.origin, self.voxel_size, self.table)


class Sample(NamedTuple):
    """Points of map b and their weights, 0 for padding.

    Attributes:
        points: Places in frame b [m].
        normals: Unit normals there; of length 0 where there is no plane.
        weights: At least 0; their sum is the share of the cost that the term has, times the points' mean probability
            where maps are soft.
        centroid: Centroid of map b [m].
    """

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    weights: Float[Array, "n"]
    centroid: Float[Array, "3"]

    def thinned(self, stride: int) -> "Sample":
        """Every `stride`-th point; together they weigh as much as all."""
        points, normals, weights = (rows[::stride] for rows in self[:3])
        least = jnp.finfo(weights.dtype).tiny
        # Weights are scaled to the old sum, so that costs of thinned and whole problems compare.
        total, left = (jnp.sum(w, dtype=w.dtype) for w in (self.weights, weights))
        return Sample(points, normals, weights * (total / jnp.maximum(left, least)), self.centroid)


class Meeting(NamedTuple):
    """What points meet under a pose, by columns.

    Attributes:
        anchor: Point on the surface, near the nearest voxel of it [m].
        normal: Unit normals of the surface there.
        planarity: How far to trust these normals, in [0, 1].
        is_match: There is a voxel in reach, and it does not face another way (the other side of a wall, a floor upon a
            ceiling).
        trust: Trust of the voxels met, 1 for no match; None for 1 everywhere.
    """

    anchor: list[Array]
    normal: list[Array]
    planarity: Float[Array, "n"]
    is_match: Bool[Array, "n"]
    trust: Float[Array, "n"] | None


def meet(
    surface: NearestSurface, points: Columns, normals: Float[Array, "n 3"], rotation: Float[Array, "3 3"]
) -> Meeting:
    """Look up the nearest voxels of a surface.

    Args:
        surface: The surface that is looked at.
        points: The points, moved into its frame [m].
        normals: Normals of the points, not yet turned; of length 0 where there is no plane.
        rotation: The rotation that turns them.
    """
    # Surfaces whose normals differ by more than 60 degrees do not match.
    min_cosine = 0.5
    places = [(points[i] - surface.origin[i]) / surface.voxel_size for i in range(3)]
    # This always holds, which a compiler cannot know: see `materialized`.
    is_valid = surface.voxel_size > 0
    is_near, row = nearest_rows(surface.keys, lambda: surface.block.cells_at(places), is_valid)
    normal, anchor, planarity = materialized(
        lambda: (
            row_entries(surface.normals, row),
            row_entries(surface.points, row),
            entries(surface.planarity, row),
        ),
        is_valid,
    )
    cosine = dot(normal, turn_columns(rotation, normals.T))
    # Unless both maps know free space, a normal may point either way.
    cosine = jnp.where(surface.is_signed, cosine, jnp.abs(cosine))
    # Where either has no plane, there is no angle to refuse a match by.
    has_normals = (planarity > MIN_PLANARITY) & jnp.any(normals != 0.0, axis=-1)
    is_match = is_near & ~(has_normals & (cosine < min_cosine))
    trust = surface.trust
    if trust is not None:
        trust = jnp.where(is_match, entries(trust, row), jnp.ones_like(planarity))
    return Meeting(anchor, normal, planarity, is_match, trust)


class PointToPlane(Term):
    """Points of one map against the planes of the other: in full across a surface, little along it.

    A point with nothing in reach costs as much as one at the end of the field's reach, with no slope.

    Attributes:
        surface: Surface of the map that the points are held against.
        sample: The points.
        slide: Weight of a distance along a plane, beside 1 for one across it.
        loss: What a large offset costs.
        is_inverse: Whether the points are map a's.
    """

    surface: NearestSurface
    sample: Sample
    slide: Float[Array, ""]
    loss: Loss = eqx.field(static=True, default="geman_mcclure")
    is_inverse: bool = eqx.field(static=True, default=False)

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, "3 n"]:
        """See `Term`."""
        # Which voxel is the nearest jumps with the pose: the derivative is that with matches held.
        return self.holding(self.met(jax.lax.stop_gradient(T_a_b))).rows(T_a_b, level)

    def met(self, T_a_b: Float[Array, "4 4"]) -> Meeting:
        """See `Term`."""
        # The unknown is one pose whichever map's points are moved; the second way looks through its inverse.
        T = rigid.inverse(T_a_b) if self.is_inverse else T_a_b
        return meet(self.surface, moved_columns(T, self.sample.points), self.sample.normals, T[:3, :3])

    def holding(self, met: Meeting) -> "HeldPointToPlane":
        """See `Term`."""
        # What a point without a match costs: an offset of so many voxels, the reach of the field.
        far_voxels = 5.0
        far = jnp.asarray(self.surface.voxel_size * far_voxels)
        return HeldPointToPlane(
            meeting=met,
            sample=self.sample,
            slide=self.slide,
            far=far,
            loss=self.loss,
            is_inverse=self.is_inverse,
        )

    def thinned(self, stride: int) -> "PointToPlane":
        """See `Term`."""
        return PointToPlane(self.surface, self.sample.thinned(stride), self.slide, self.loss, self.is_inverse)


class HeldPointToPlane(PointTerm):
    """Points and the planes that they keep: smooth in the pose.

    Attributes:
        meeting: The planes.
        sample: The points.
        slide: Weight of offsets along a plane, as in `PointToPlane`.
        far: Offset that a point without a match costs [m].
        loss: What a large offset costs, as in `PointToPlane`.
        is_inverse: Whether the points are moved by the inverse of the pose, as in `PointToPlane`.
    """

    meeting: Meeting
    sample: Sample
    slide: Float[Array, ""]
    far: Float[Array, ""]
    loss: Loss = eqx.field(static=True)
    is_inverse: bool = eqx.field(static=True)

    def points(self) -> Float[Array, "n 3"]:
        """See `PointTerm`."""
        return self.sample.points

    def weights(self) -> Float[Array, "n"]:
        """See `PointTerm`."""
        trust = self.meeting.trust
        return self.sample.weights if trust is None else self.sample.weights * trust

    def offsets(self, points: Columns, level: Level) -> Columns:
        """See `PointTerm`."""
        met = self.meeting
        gap = [p - q for p, q in zip(points, met.anchor, strict=True)]
        # The offset is split into the part across the plane, which counts in full, and the one along it, which
        # counts little.
        distance = dot(gap, met.normal)
        # Where there is no plane there is no along either: all directions count in full, as point to point.
        along = self.slide * met.planarity + (1.0 - met.planarity)
        offset = [
            (n * distance + along * (g - n * distance)) / level.scale
            for g, n in zip(gap, met.normal, strict=True)
        ]
        # A constant offset costs, so that losing matches never pays, but it pulls nowhere.
        far = (self.far / level.scale, 0.0, 0.0)
        return [jnp.where(met.is_match, o, f) for o, f in zip(offset, far, strict=True)]
