"""Whether one of two maps is given in another unit of length, by how wide both are and how wide their voxels are."""

import numpy as np
from jaxtyping import Float

from ...grid import VoxelGrid

FAR_UNITS = (0.001, 0.01, 0.0254, 1 / 0.0254, 100.0, 1000.0)
"""What lengths are multiplied by where millimetres, centimetres or inches were taken for metres, or reversely: at one
voxel size, one of both maps vanishes in a voxel."""

FEET = (0.3048, 1 / 0.3048)
"""The same for feet."""


def far_unit(a: VoxelGrid, b: VoxelGrid) -> float | None:
    """Which of the far units would make map b about as large as map a; None for none, and where a map is empty.

    Only boxes are looked at. Those of one place differ, with the frames and with what was seen of it, and so do voxels;
    but a scan in a map of a whole town has voxels about as wide as those of the town.

    Args:
        a: First map.
        b: Second map.
    """
    # Ratios of diagonals and of voxels that one unit may have.
    most_diagonal, most_voxel = 2.0, 5.0
    if not (a.num_occupied and b.num_occupied):
        return None
    diagonal = _diagonal(a) / _diagonal(b)
    voxel = a.voxel_size / b.voxel_size
    off = {
        unit: abs(np.log(diagonal / unit))
        for unit in FAR_UNITS
        if 1 / most_diagonal < diagonal / unit < most_diagonal and 1 / most_voxel < voxel / unit < most_voxel
    }
    return min(off, key=off.__getitem__) if off else None


def feet_between(a: VoxelGrid, b: VoxelGrid) -> float | None:
    """Which factor for feet would make map b about as large as map a along each of its axes; None for none.

    A room and the storey that it is in may differ by as much, but not in height.

    Args:
        a: First map, with something occupied.
        b: Second map, likewise.
    """
    # Ratio that spreads of two parts of one place may have.
    most = 1.6
    ratio = _spreads(a) / np.maximum(_spreads(b), 1e-12)
    for unit in FEET:
        if ((ratio / unit < most) & (ratio / unit > 1 / most)).all():
            return unit
    return None


def _diagonal(grid: VoxelGrid) -> float:
    """Diagonal of the box around what is known [m]."""
    low, high = grid.known_box()
    return float(np.linalg.norm((high - low) * grid.voxel_size))


def _spreads(grid: VoxelGrid) -> Float[np.ndarray, "3"]:
    """Standard deviations of occupied voxels along the axes of their scatter, least first [m]; alike in any frame."""
    points = grid.occupied_index().astype(np.float64)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T, bias=True)), 0.0)) * grid.voxel_size
