"""What residuals that read a field between voxel centres have in common: points, the cells they lie in, and weights."""

import jax
from equinox import AbstractVar
from jaxtyping import Float

from ... import rigid
from ..._types import Array
from .fields import Cells, Field, cells_around
from .losses import Loss
from .planes import Sample
from .terms import Level, PointTerm, Term, moved_columns


class FieldTerm(Term):
    """Points of one map in a field of the other.

    Attributes:
        field: Values of the map that the points are held against.
        sample: The points; their normals are not used.
        loss: What a large offset costs.
        is_inverse: Whether the points are map a's.
    """

    field: AbstractVar[Field]
    sample: AbstractVar[Sample]
    loss: AbstractVar[Loss]
    is_inverse: AbstractVar[bool]

    def rows(self, T_a_b: Float[Array, "4 4"], level: Level) -> Float[Array, "1 n"]:
        """See `Term`."""
        # Which cells points lie in jumps with the pose; inside of them, values change smoothly.
        return self.holding(self.met(jax.lax.stop_gradient(T_a_b))).rows(T_a_b, level)

    def met(self, T_a_b: Float[Array, "4 4"]) -> Cells:
        """See `Term`."""
        T = rigid.inverse(T_a_b) if self.is_inverse else T_a_b
        return cells_around(self.field, moved_columns(T, self.sample.points))


class HeldFieldTerm(PointTerm):
    """Points that keep their cells.

    Attributes:
        cells: Cells that the points lie in.
        sample: The points.
    """

    cells: AbstractVar[Cells]
    sample: AbstractVar[Sample]

    def points(self) -> Float[Array, "n 3"]:
        """See `PointTerm`."""
        return self.sample.points

    def weights(self) -> Float[Array, "n"]:
        """See `PointTerm`."""
        return self.sample.weights
