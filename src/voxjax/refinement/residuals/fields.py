"""Fields of values near the surfaces of a map, read between voxel centres.

Values are kept for the voxels near surfaces only, so that a derivative with respect to them is as short as they are; a
table says where the value of a voxel is.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32

from ..._types import Array
from ...ops.evidence.lookup import Block, entries
from .terms import Columns

CORNERS = tuple(np.ndindex(2, 2, 2))


class Field(NamedTuple):
    """Values at voxel centres.

    Attributes:
        rows: Flat: row of `values` of each voxel of the block.
        dims: Size of the block [voxel].
        origin: Outer corner of that block [m].
        voxel_size: Edge length of a voxel [m].
        values: Values of the voxels near surfaces, and of what is elsewhere.
        outside: Row of `values` that holds what is outside of the block.
        table: Where the rows of a block of voxels are, see `Block`; None for dense rows.
    """

    rows: Int32[Array, "flat"]
    dims: Int32[Array, "3"]
    origin: Float[Array, "3"]
    voxel_size: Float[Array, ""]
    values: Float[Array, "m"]
    outside: Int32[Array, ""]
    table: Int32[Array, "blocks"] | None = None

    @property
    def block(self) -> Block:
        """Where the rows lie."""
        return Block(self.dims, self.origin, self.voxel_size, self.table)


class Cells(NamedTuple):
    """The eight voxel centres around points, and what the field is there.

    Attributes:
        low: Centre of the lowest of the eight, by columns [m].
        voxel_size: Edge length of a voxel [m].
        values: Values of the eight, in the order of `CORNERS`.
    """

    low: list[Array]
    voxel_size: Float[Array, ""]
    values: list[Array]

    def at(self, points: Columns) -> Float[Array, "n"]:
        """Trilinear value at points; beyond the cell the polynomial goes on."""
        # Shares are taken in the cell that was looked up, also after a point has left it: held cells stay
        # smooth.
        high = [(p - low) / self.voxel_size for p, low in zip(points, self.low, strict=True)]
        share = [(1.0 - h, h) for h in high]
        parts = [
            share[0][i] * share[1][j] * share[2][k] * value
            for (i, j, k), value in zip(CORNERS, self.values, strict=True)
        ]
        return sum(parts[1:], start=parts[0])


def cells_around(field: Field, points: Columns) -> Cells:
    """Look up the cells of points [m]; differentiable in the values, constant in the points."""
    block, outside = field.block, jnp.asarray(field.outside)
    # Values belong to centres, which lie half a voxel from the corner that is the origin.
    place = [jnp.floor((points[i] - field.origin[i]) / field.voxel_size - 0.5) for i in range(3)]
    values = []
    for corner in CORNERS:
        # Half a voxel more leads to the middle of a voxel, where rounding cannot lead into the next one.
        cell, is_inside = block.cells_at([place[i] + (corner[i] + 0.5) for i in range(3)])
        values.append(entries(field.values, jnp.where(is_inside, entries(field.rows, cell), outside)))
    low = [(place[i] + 0.5) * field.voxel_size + field.origin[i] for i in range(3)]
    return Cells(low, field.voxel_size, values)
