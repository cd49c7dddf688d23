"""Free space of maps that record none, from what encloses it.

A cloud of points says where surfaces are, not where the sensor saw through. But surfaces were seen from somewhere: a
place with surfaces near it in most directions lies inside the room that they bound, and is free as a rule. On generated
buildings stripped of their free space 97 to 99 % of what is inferred had been seen to be free
(`python -m bench inferred_space`). Places with open sides are left unknown. Half a scan gets too little to be of use
(`MapConfig.min_inferred`), and the evidence degrades to hits alone.
"""

import numpy as np
from jaxtyping import Bool, UInt8

from .._runtime.threads import spread
from .._types import FREE, OCCUPIED
from ..grid import VoxelGrid
from ..ops.surface.enclosure import is_enclosed
from .inferred_blocks import CELL as _CELL
from .inferred_blocks import infer_in_blocks
from .settings import MapConfig

_SLAB = 1 << 18
"""Voxels that are worked on at once."""


def infer_free_space(
    grid: VoxelGrid,
    *,
    reach: float = MapConfig.inferred_reach,
    min_directions: int = MapConfig.inferred_directions,
) -> VoxelGrid:
    """The map with enclosed unknown voxels made free.

    Args:
        grid: Any map; what it knows stays as it is.
        reach: Length of the rays [m].
        min_directions: A place is enclosed if a surface lies in at least so many of the 26 directions.

    Returns:
        A map of the same shape, origin and voxel size, in blocks if the map was; of these, parts of the box within
        reach of which nothing is occupied are passed over.
    """
    length = reach / (_CELL * grid.voxel_size)
    if grid.is_sparse:
        blocks = infer_in_blocks(grid.state_blocks(), reach=length, min_directions=min_directions)
        return VoxelGrid(blocks, grid.origin, grid.voxel_size)
    states = np.asarray(grid.states)
    enclosed = is_enclosed(_occupied_cells(states), reach=length, min_directions=min_directions)
    return VoxelGrid(_freed(states, enclosed), grid.origin, grid.voxel_size)


def _planes(states: np.ndarray) -> int:
    """Planes of cells whose voxels stay in the cache of a core."""
    return max(_SLAB // max(_CELL * states[:1].size, 1), 1)


def _occupied_cells(states: UInt8[np.ndarray, "x y z"]) -> Bool[np.ndarray, "a b c"]:
    """Cells that hold an occupied voxel."""
    cells = np.empty(tuple(-(-n // _CELL) for n in states.shape), bool)
    step = _planes(states)

    def fill(start: int) -> None:
        part = states[_CELL * start : _CELL * (start + step)] == OCCUPIED
        for axis in range(3):
            # The last cell has one voxel along an axis whose number of voxels is odd.
            first, second = (part[(slice(None),) * axis + (slice(k, None, _CELL),)] for k in range(_CELL))
            first[tuple(slice(0, n) for n in second.shape)] |= second
            part = first
        cells[start : start + step] = part

    spread(fill, range(0, len(cells), step))
    return cells


def _freed(
    states: UInt8[np.ndarray, "x y z"], cells: Bool[np.ndarray, "a b c"]
) -> UInt8[np.ndarray, "x y z"]:
    """The states with the unknown voxels of some cells free."""
    freed = np.empty_like(states)
    step = _planes(states)

    def fill(start: int) -> None:
        known, new = (a[_CELL * start : _CELL * (start + step)] for a in (states, freed))
        part = cells[start : start + step]
        if not part.any():
            new[:] = known
            return
        # Cells go back to voxels by repetition; what stands over the rim of the map is cut off.
        for axis in (2, 1, 0):
            part = np.repeat(part, _CELL, axis=axis)
        part = part[tuple(slice(0, n) for n in known.shape)]
        # Of the states, unknown is the least and free the next one.
        np.maximum(known, part.view(np.uint8) * FREE, out=new)

    spread(fill, range(0, len(cells), step))
    return freed
