"""What a map holds, in figures: of a grid, or of leaves, of which no grid is made for that."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._types import FREE, OCCUPIED
from ..grid import VoxelGrid
from .leaves import LeafMap


class MapFacts(NamedTuple):
    """Figures of a map.

    Attributes:
        voxel_size: Edge length of a voxel [m].
        shape: Number of voxels along x, y, z.
        low: Lowest corner [m].
        high: Highest corner [m].
        num_occupied: Number of occupied voxels.
        num_free: Number of free voxels.
        has_log_odds: Whether its source had probabilities.
    """

    voxel_size: float
    shape: tuple[int, int, int]
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    num_occupied: int
    num_free: int
    has_log_odds: bool

    @property
    def num_voxels(self) -> int:
        """Number of voxels of the box."""
        return math.prod(self.shape)

    @property
    def num_bytes(self) -> int:
        """Memory that dense arrays of the whole box would take [byte]."""
        return self.num_voxels * (5 if self.has_log_odds else 1)


def facts_of_grid(grid: VoxelGrid) -> MapFacts:
    """Figures of a grid."""
    counts = grid.num_occupied, grid.num_free
    return MapFacts(grid.voxel_size, grid.shape, *grid.extent, *counts, grid.has_log_odds)


def facts_of_leaves(leaves: LeafMap) -> MapFacts:
    """Figures of the grid that some leaves make at their own voxel size."""
    shape, (low, high) = leaves.shape, leaves.extent
    if not leaves.levels:
        # A map of nothing is read as one unknown voxel.
        shape, high = (1, 1, 1), low + leaves.resolution
    counts = leaves.count(OCCUPIED), leaves.count(FREE)
    return MapFacts(leaves.resolution, shape, low, high, *counts, leaves.has_log_odds)
