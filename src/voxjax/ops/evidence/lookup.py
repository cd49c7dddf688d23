"""Values of a field at points, for a box whose size is traced.

A field is flat: dense, a cell for each voxel of the box, or a pool of blocks of 8 x 8 x 8 voxels, with a table that
says for each block of the box which row of the pool it is. A lookup in a pool reads the table and then the pool.

Points go by columns, one array for each of x, y and z: arrays whose last axis is 3 run ten times slower on a CPU.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int32

from ..._runtime.tables import check_cells
from ..._types import Array


class Block(NamedTuple):
    """Where a flat field lies.

    Attributes:
        dims: Size [voxel].
        origin: Outer corner [m].
        voxel_size: Width of a voxel [m].
        table: Row of the field, in rows of 512 cells, of each block of 8 x 8 x 8 voxels, in C order over the blocks; it
            may be longer. None for a dense field, which has a cell for each voxel in C order.
    """

    dims: Int32[Array, "3"]
    origin: Float32[Array, "3"]
    voxel_size: Float32[Array, ""] | np.floating | float
    table: Int32[Array, "blocks"] | None = None

    @classmethod
    def of(
        cls,
        dims: Array,
        origin: Array,
        voxel_size: Array | np.generic | float,
        table: Array | None = None,
    ) -> "Block":
        """A block from what a caller of a kernel gives: NumPy arrays and numbers serve as well as device arrays."""
        given = jnp.asarray(dims), jnp.asarray(origin), jnp.asarray(voxel_size, jnp.float32)
        return cls(*given, None if table is None else jnp.asarray(table))

    def cells_under(self, T: Array, columns: Array) -> tuple[Array, Array]:
        """Cells of points (as rows x, y and z) under a pose, and whether they lie inside."""
        # The pose is brought to voxels once, and not each point.
        rotation, shift = T[:3, :3] / self.voxel_size, (T[:3, 3] - self.origin) / self.voxel_size
        return self.cells_at([c + shift[i] for i, c in enumerate(turn_columns(rotation, columns))])

    def cells_at(self, places: Sequence[Array]) -> tuple[Array, Array]:
        """Cells at x, y and z [voxel] from the outer corner, 0 beyond the block, and whether they lie inside."""
        x, y, z = (jnp.floor(place).astype(jnp.int32) for place in places)
        # Unsigned: what is below 0 is far above.
        is_below = [
            cell.astype(jnp.uint32) < self.dims[i].astype(jnp.uint32) for i, cell in enumerate((x, y, z))
        ]
        is_inside = is_below[0] & is_below[1] & is_below[2]
        # Outside, where the product may wrap round, cell 0 is looked up, so that no lookup need check its bounds.
        if self.table is None:
            return jnp.where(is_inside, (x * self.dims[1] + y) * self.dims[2] + z, 0), is_inside
        # A side of 8 takes shifts in place of divisions.
        height, depth = ((self.dims[i] + 7) >> 3 for i in (1, 2))
        block = ((x >> 3) * height + (y >> 3)) * depth + (z >> 3)
        row = self.rows_of(jnp.where(is_inside, block, 0))
        cell = (row << 9) | ((x & 7) << 6) | ((y & 7) << 3) | (z & 7)
        return jnp.where(is_inside, cell, 0), is_inside

    def rows_of(self, block: Array) -> Array:
        """Rows of the pool for blocks of the box, by their numbers in C order."""
        assert self.table is not None  # a dense field has no rows
        return entries(self.table, block)


def lookup(field: Array, block: Block, points: Float32[Array, "*n 3"], outside: np.generic) -> Array:
    """Value of a flat field at points [m]; `outside` beyond the block."""
    places = [(points[..., axis] - block.origin[axis]) / block.voxel_size for axis in range(3)]
    return values_at(field, *block.cells_at(places), outside)


def cells_on_host(
    places: Iterable[np.ndarray], shape: Sequence[int], table: Int32[np.ndarray, "blocks"] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """`Block.cells_at` in NumPy, for arrays of any length and shape.

    Args:
        places: Float32 x, y and z [voxel] from the outer corner of the block; they are rounded down in place.
        shape: Size of the block [voxel].
        table: Row of the pool of each block of 8 x 8 x 8 voxels; None for a dense field.

    Returns:
        Flat cells int32, 0 beyond the block, and whether they lie inside.
    """
    # Of a dense field all is the number of a voxel; of a pool the number of a block, and the place within it.
    flat, inner, is_inside = np.int32(0), np.int32(0), np.True_
    for place, size in zip(places, shape, strict=True):
        cell = np.floor(place, out=place).astype(np.int32)
        # Unsigned: what is below 0 is far above.
        is_inside = is_inside & (cell.view(np.uint32) < np.uint32(size))
        if table is not None:
            inner = (inner << 3) | (cell & 7)
            cell >>= 3
            size = -(-size // 8)
        # Outside of the block the product may wrap round; what comes of it is replaced below.
        flat = flat * np.int32(size) + cell
    flat = np.where(is_inside, flat, 0)
    if table is not None:
        flat = np.where(is_inside, (np.take(table, flat) << 9) | inner, 0)
    return flat, np.asarray(is_inside)


def turned_on_host(rotation: np.ndarray, columns: np.ndarray) -> Iterator[np.ndarray]:
    """`turn_columns` in NumPy, one axis after the other, so that no more than one array is held."""
    for row in rotation:
        place = row[0] * columns[0]
        place += row[1] * columns[1]
        place += row[2] * columns[2]
        yield place


def entries(field: Array, row: Array) -> Array:
    """Entries of a flat field, at rows that it has: bounds and signs are not looked at again.

    Raises:
        InputError: If the field is longer than int32 can count.
    """
    check_cells(field.shape[0], 0, "a field", "look it up tile by tile")
    return jnp.asarray(field).at[row].get(mode="promise_in_bounds", wrap_negative_indices=False)


def row_entries(table: Float[Array, "m 3"], row: Array) -> list[Array]:
    """Rows of a table of vectors, by columns; of the flat table, because columns of it would be copied first."""
    flat = jnp.asarray(table).reshape(-1)
    return [entries(flat, 3 * row + axis) for axis in range(3)]


def values_at(field: Array, cell: Array, is_inside: Array, outside: np.generic) -> Array:
    """Entries at cells of a block, `outside` where they are not inside."""
    return jnp.where(is_inside, entries(field, cell), jnp.asarray(outside, field.dtype))


def turn_columns(rotation: Array, columns: Array) -> list[Array]:
    """Vectors as rows x, y and z, turned."""
    # The product is written out: one of matrices may run in a lower precision on some devices.
    x, y, z = columns
    return [rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3)]
