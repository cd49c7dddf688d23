"""Points of one map in the truncated distance field of another, signed where the map knows which side is free."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int32

from ..._types import Array
from .field_terms import FieldTerm, HeldFieldTerm
from .fields import Cells, Field
from .losses import Loss
from .planes import Sample
from .terms import Columns, Level, dot


class Distances(FieldTerm):
    """Points of one map at the zero of the other's distance field, read between voxel centres.

    Attributes:
        field: Distances [m], by `plane_distances`; outside what a point far from everything costs.
        sample: The points; their normals are not used.
        loss: What a large offset costs.
        is_inverse: Whether the points are map a's.
    """

    field: Field
    sample: Sample
    loss: Loss = eqx.field(static=True, default="geman_mcclure")
    is_inverse: bool = eqx.field(static=True, default=False)

    def holding(self, met: Cells) -> "HeldDistances":
        """See `Term`."""
        return HeldDistances(cells=met, sample=self.sample, loss=self.loss, is_inverse=self.is_inverse)

    def thinned(self, stride: int) -> "Distances":
        """See `Term`."""
        return Distances(self.field, self.sample.thinned(stride), self.loss, self.is_inverse)


class HeldDistances(HeldFieldTerm):
    """`Distances` of points that keep their cells.

    Attributes:
        cells: Cells that the points lie in.
        sample: The points.
        loss: What a large offset costs, as in `Distances`.
        is_inverse: Whether the points are moved by the inverse of the pose, as in `Distances`.
    """

    cells: Cells
    sample: Sample
    loss: Loss = eqx.field(static=True)
    is_inverse: bool = eqx.field(static=True)

    def offsets(self, points: Columns, level: Level) -> Columns:
        """See `PointTerm`."""
        return [self.cells.at(points) / level.scale]


@jax.jit
def plane_distances(
    centres: Float[Array, "m 3"],
    nearest: Int32[Array, "m"],
    anchors: Float[Array, "k 3"],
    normals: Float[Array, "k 3"],
    is_signed: Bool[Array, "k"],
    *,
    voxel_size: Float[Array, ""],
    reach: Float[Array, ""],
) -> Float[Array, "m"]:
    """Distance of voxel centres from the piece of plane at the nearest surface voxel, sub-voxel and truncated [m].

    Args:
        centres: Centres of voxels near surfaces [m].
        nearest: Row of the nearest surface voxel of each.
        anchors: Points on the planes around the surface voxels [m].
        normals: Unit normals there.
        is_signed: Whether the normal there points to free space: distances are then negative behind the surface.
            Elsewhere they are the distance from the anchor.
        voxel_size: Width of a piece of plane [m]: the farther part of a distance along it counts.
        reach: Distances are cut off here [m].

    References:
        Curless and Levoy, A volumetric method for building complex models from range images, 1996.
    """
    # Both parts of the distance are from the same anchor: across the plane, and along it.
    gap = [c - a for c, a in zip(centres.T, anchors[nearest].T, strict=True)]
    across = dot(gap, list(normals[nearest].T))
    # Rounding may leave the square of the part along the plane a little below 0.
    squared, along_squared = dot(gap, gap), jnp.maximum(dot(gap, gap) - across * across, 0.0)
    # The root has no finite slope at 0; this is far below any square of a length that counts.
    tiny = jnp.asarray(1e-12, across.dtype)
    beyond = jnp.maximum(jnp.sqrt(along_squared + tiny) - voxel_size, 0.0)
    signed = jnp.where(across < 0.0, -1.0, 1.0) * jnp.sqrt(across * across + beyond * beyond + tiny)
    # Beside the edge of a surface only: straight above it the distance is linear, also through zero.
    signed = jnp.where(beyond > 0.0, signed, across)
    # Without a side, the distance from the anchor says nothing about which way is out, but has the right zero.
    distance = jnp.where(is_signed[nearest], signed, jnp.sqrt(squared + tiny))
    return jnp.clip(distance, -reach, reach)
