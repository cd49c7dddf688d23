"""The main part of a map: what is worked on where strays far away would only make the box larger.

Fusion and files keep every voxel. Features are made of the main part alone, so that a stray voxel kilometres away costs
nothing and decides nothing.
"""

import numpy as np
from jaxtyping import Int

from .._types import UNKNOWN
from ..grid import VoxelGrid
from ..ops.blocks.block_array import BlockArray
from ..ops.blocks.edit import with_value, zeroed_outside
from .isolated import IsolatedPieces, isolated_pieces


def main_part(grid: VoxelGrid) -> tuple[VoxelGrid, int]:
    """A map without its isolated far pieces (`isolated_pieces`).

    Args:
        grid: The map.

    Returns:
        The map itself where no piece is isolated; else the part of it in the box around what is not, wider by its
        diagonal on each side, without the pieces. And how many occupied voxels were left out.

    Raises:
        InputError: If there is not enough memory for the list of occupied voxels.
    """
    index = grid.occupied_index()
    pieces = isolated_pieces(index)
    if not len(pieces.distance):
        return grid, 0
    return without_pieces(grid, index, pieces), int(pieces.num_voxels.sum())


def without_pieces(grid: VoxelGrid, index: Int[np.ndarray, "n 3"], pieces: IsolatedPieces) -> VoxelGrid:
    """A map without its isolated pieces, and without the free space that was seen on the way to them.

    Args:
        grid: The map.
        index: Its `occupied_index`.
        pieces: What `isolated_pieces` gives for these indices, at least one piece.
    """
    # Centres this near to a face of the box [voxel] lie on it.
    tie = 1e-4
    low, high = (
        np.clip(np.ceil(corner - tie), 0, grid.shape).astype(np.int64) for corner in (pieces.low, pieces.high)
    )
    # A piece may still lie in a corner of the box.
    inside = index[pieces.piece >= 0] - low
    inside = inside[((inside >= 0) & (inside < high - low)).all(axis=1)]
    part = grid.cut(low, high)
    states, log_odds = _without_blocks(part, inside) if grid.is_sparse else _without_dense(part, inside)
    return VoxelGrid(states, part.origin, grid.voxel_size, log_odds).crop_to_known()


def _without_dense(grid: VoxelGrid, index: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """States of a dense map with some voxels unknown, and its log-odds, 0 where nothing is known."""
    states = np.array(grid.states)
    states[tuple(index.T)] = UNKNOWN
    if grid.log_odds is None:
        return states, None
    return states, np.where(states == UNKNOWN, np.float32(0.0), np.asarray(grid.log_odds))


def _without_blocks(grid: VoxelGrid, index: np.ndarray) -> tuple[BlockArray, BlockArray | None]:
    """The same of a map that is kept in blocks."""
    states, log_odds = with_value(grid.state_blocks(), index, UNKNOWN), grid.log_odds_blocks()
    return states, None if log_odds is None else zeroed_outside(log_odds, states)
