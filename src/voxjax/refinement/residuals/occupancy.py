"""Soft agreement of what two maps say of the same places: occupied, free, or nothing."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from ..._types import Array
from .field_terms import FieldTerm, HeldFieldTerm
from .fields import Cells, Field
from .losses import Loss
from .planes import Sample
from .terms import Columns, Level


def opinion(log_odds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Log-odds as an opinion in [-1, 1]: 1 surely occupied, -1 surely free, 0 unknown; `2 p - 1`."""
    return jnp.tanh(0.5 * log_odds)


class Occupancies(FieldTerm):
    """Each point says something of its place, and so does the other map: the offset is the difference.

    Squared, agreement costs 0, a place that the other map does not know 1, and a conflict (occupied in free space, or
    free space where the other map has a surface) 4. Steep within a voxel of a surface only, so that it takes a good
    start, coarse maps, or other terms beside it.

    Attributes:
        field: Opinions of the map that the points are held against, see `opinion`.
        sample: Voxel centres of the other map, occupied and free; their normals are not used.
        said: Opinion of each point.
        loss: What a large difference costs; they are bounded anyway.
        is_inverse: Whether the points are map a's.
    """

    field: Field
    sample: Sample
    said: Float[Array, "n"]
    loss: Loss = eqx.field(static=True, default="squared")
    is_inverse: bool = eqx.field(static=True, default=False)

    def holding(self, met: Cells) -> "HeldOccupancies":
        """See `Term`."""
        return HeldOccupancies(
            cells=met, sample=self.sample, said=self.said, loss=self.loss, is_inverse=self.is_inverse
        )

    def thinned(self, stride: int) -> "Occupancies":
        """See `Term`."""
        return Occupancies(
            field=self.field,
            sample=self.sample.thinned(stride),
            said=self.said[::stride],
            loss=self.loss,
            is_inverse=self.is_inverse,
        )


class HeldOccupancies(HeldFieldTerm):
    """`Occupancies` of points that keep their cells.

    Attributes:
        cells: Cells that the points lie in.
        sample: The points.
        said: Opinion of each point.
        loss: What a large offset costs, as in `Occupancies`.
        is_inverse: Whether the points are moved by the inverse of the pose, as in `Occupancies`.
    """

    cells: Cells
    sample: Sample
    said: Float[Array, "n"]
    loss: Loss = eqx.field(static=True)
    is_inverse: bool = eqx.field(static=True)

    def offsets(self, points: Columns, level: Level) -> Columns:
        """See `PointTerm`."""
        del level
        # Opinions have no length: the robust scale of the level does not apply to them.
        return [self.cells.at(points) - self.said]
