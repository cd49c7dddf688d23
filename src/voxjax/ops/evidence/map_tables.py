"""The tables of one map that lookups share: keys of the nearest voxel and evidence codes, in lengths shared by maps.

A table has one of the few lengths of `_runtime.tables`; what follows the map in it is never looked up, and its content
means nothing. Both functions choose between slabs in NumPy (`nearest_host`) and one kernel (`nearest`, `scoring`); the
cells of the map hold the same bits either way.
"""

import numpy as np
from jaxtyping import Int32, UInt8, UInt32

from ..._runtime.placement import on_host, to_device
from ..._runtime.tables import as_table, table_lengths
from ..._types import Array
from .nearest import nearest_field
from .nearest_host import evidence_codes_on_host, nearest_field_on_host
from .scoring import evidence_codes


def nearest_table(
    index: Int32[np.ndarray, "n 3"], shape: tuple[int, int, int], *, radius: int
) -> UInt32[Array, "flat"]:
    """`nearest_field` of all occupied voxels of a map, as a table.

    Args:
        index: Different voxels inside the block, in C order.
        shape: Size of the block [voxel].
        radius: Reach [voxel], 1 to 5.

    Returns:
        Device array of the length that `table_lengths` gives for the block and the list.

    Raises:
        InputError: If the radius or the number of rows does not fit the key.
    """
    length, num_rows = table_lengths(int(np.prod(shape, dtype=np.int64)), len(index))
    if on_host(index):
        return to_device(nearest_field_on_host(index, shape, length=length, radius=radius))
    # The device's kernel belongs to the lengths of its arguments, so that its list is a table as well.
    rows, mask = as_table(index, num_rows), np.arange(num_rows) < len(index)
    return nearest_field(rows, mask, np.asarray(shape, np.int32), flat_size=length, radius=radius)


def code_table(
    states: UInt8[Array, "flat"], keys: UInt32[Array, "flat"], num_cells: int, *, hit_sq: int, clear_sq: int
) -> UInt8[Array, "flat"]:
    """`evidence_codes` of a map, as a table.

    Args:
        states: Table of the map's states.
        keys: The map's `nearest_table`.
        num_cells: Cells of the map, with which both tables begin.
        hit_sq: Squared distance [voxel^2] up to which something occupied is a hit.
        clear_sq: Squared distance [voxel^2] from which on a free voxel is well clear of anything occupied.

    Returns:
        Device array as long as the tables given.
    """
    if not on_host(states, keys):
        return evidence_codes(states, keys, hit_sq, clear_sq)
    # What follows the map in its tables is left untouched, or it would take memory for nothing.
    cells = np.asarray(states)[:num_cells], np.asarray(keys)[:num_cells]
    return to_device(evidence_codes_on_host(*cells, hit_sq, clear_sq, length=len(keys)))
