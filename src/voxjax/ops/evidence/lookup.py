"""Values of a flat field at points, for a block whose size is traced.

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
    """

    dims: Int32[Array, "3"]
    origin: Float32[Array, "3"]
    voxel_size: Float32[Array, ""] | np.floating | float

    @classmethod
    def of(cls, dims: Array, origin: Array, voxel_size: Array | np.generic | float) -> "Block":
        """A block from what a caller of a kernel gives: NumPy arrays and numbers serve as well as device arrays."""
        return cls(jnp.asarray(dims), jnp.asarray(origin), jnp.asarray(voxel_size, jnp.float32))

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
        return jnp.where(is_inside, (x * self.dims[1] + y) * self.dims[2] + z, 0), is_inside


def lookup(field: Array, block: Block, points: Float32[Array, "*n 3"], outside: np.generic) -> Array:
    """Value of a flat field at points [m]; `outside` beyond the block."""
    places = [(points[..., axis] - block.origin[axis]) / block.voxel_size for axis in range(3)]
    return values_at(field, *block.cells_at(places), outside)


def cells_on_host(places: Iterable[np.ndarray], shape: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """`Block.cells_at` in NumPy, for arrays of any length and shape.

    Args:
        places: Float32 x, y and z [voxel] from the outer corner of the block; they are rounded down in place.
        shape: Size of the block [voxel].

    Returns:
        Flat cells int32, 0 beyond the block, and whether they lie inside.
    """
    flat, is_inside = np.int32(0), np.True_
    for place, size in zip(places, shape, strict=True):
        cell = np.floor(place, out=place).astype(np.int32)
        # Unsigned: what is below 0 is far above.
        is_inside = is_inside & (cell.view(np.uint32) < np.uint32(size))
        # Outside of the block the product may wrap round; what comes of it is replaced below.
        flat = flat * np.int32(size) + cell
    return np.where(is_inside, flat, 0), np.asarray(is_inside)


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
