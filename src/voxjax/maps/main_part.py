"""The main part of a map: what is worked on where strays far away would only make the box larger.

Fusion and files keep every voxel. Features are made of the main part alone, so that a stray voxel kilometres away costs
nothing and decides nothing.
"""

import numpy as np

from .._types import UNKNOWN
from ..grid import VoxelGrid
from .isolated import isolated_pieces


def main_part(grid: VoxelGrid) -> tuple[VoxelGrid, int]:
    """A map without its isolated far pieces (`isolated_pieces`).

    Args:
        grid: The map.

    Returns:
        The map itself where no piece is isolated; else the part of it in the box around what is not, wider by its
        diagonal on each side, without the pieces; log-odds are left out. And how many voxels were left out.

    Raises:
        InputError: If there is not enough memory for the list of occupied voxels.
    """
    index = grid.occupied_index()
    pieces = isolated_pieces(index)
    is_isolated = pieces.piece >= 0
    if not is_isolated.any():
        return grid, 0
    # Free space beyond that box was seen by rays to the pieces.
    low = np.maximum(np.ceil(pieces.low), 0).astype(np.int64)
    high = np.minimum(np.floor(pieces.high) + 1, grid.shape).astype(np.int64)
    states = np.array(np.asarray(grid.states)[tuple(map(slice, low.tolist(), high.tolist()))])
    # A piece may still lie in a corner of the box.
    inside = index[is_isolated] - low
    inside = inside[((inside >= 0) & (inside < states.shape)).all(axis=1)]
    states[tuple(inside.T)] = UNKNOWN
    origin = np.asarray(grid.origin, np.float64) + low * grid.voxel_size
    return VoxelGrid(states, origin, grid.voxel_size).crop_to_known(), int(np.count_nonzero(is_isolated))
