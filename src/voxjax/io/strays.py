"""Isolated far pieces of a dense map: found, remarked, and left out on request."""

import numpy as np
from jaxtyping import Int

from .._types import UNKNOWN
from ..grid import VoxelGrid
from ..maps.findings import Remark, isolated_remark, units_remark
from ..maps.isolated import IsolatedPieces, isolated_pieces
from .crop import crop_grid


def without_strays(grid: VoxelGrid, *, is_dropped: bool) -> tuple[VoxelGrid, list[Remark]]:
    """Look for isolated pieces of a map, and for what its lengths hint at.

    Args:
        grid: The map.
        is_dropped: Whether isolated pieces are left out.

    Returns:
        The map, the given one if nothing is left out, and remarks about pieces and units.

    Raises:
        InputError: If there is not enough memory for the list of occupied voxels.
    """
    index = grid.occupied_index()
    if not len(index):
        return grid, []
    pieces = isolated_pieces(grid.world_from_index(index), voxel_size=grid.voxel_size)
    kept = _without(grid, index, pieces) if is_dropped and len(pieces.distance) else grid
    return kept, piece_remarks(pieces, grid.voxel_size, is_dropped=is_dropped)


def piece_remarks(pieces: IsolatedPieces, spacing: float, *, is_dropped: bool) -> list[Remark]:
    """What the isolated pieces of a map, and the lengths of its main part, give to say.

    Args:
        pieces: What was found, in metres.
        spacing: Voxel size, or how far apart the points of a cloud lie [m].
        is_dropped: Whether isolated pieces are left out.
    """
    remarks = [isolated_remark(pieces, is_dropped=is_dropped), units_remark(spacing, pieces.sides)]
    return [remark for remark in remarks if remark is not None]


def _without(grid: VoxelGrid, index: Int[np.ndarray, "n 3"], pieces: IsolatedPieces) -> VoxelGrid:
    """The map without its isolated pieces, and without the free space that was seen on the way to them."""
    states = np.array(grid.states)
    states[tuple(index[pieces.piece >= 0].T)] = UNKNOWN
    log_odds = None
    if grid.log_odds is not None:
        log_odds = np.where(states == UNKNOWN, np.float32(0.0), np.asarray(grid.log_odds))
    return crop_grid(
        VoxelGrid(states, grid.origin, grid.voxel_size, log_odds), np.stack([pieces.low, pieces.high])
    )
