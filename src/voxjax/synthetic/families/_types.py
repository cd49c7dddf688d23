"""Two maps and how they lie to each other."""

from dataclasses import dataclass

import numpy as np

from ...grid import VoxelGrid


@dataclass(frozen=True)
class FamilyMaps:
    """Two maps of a family.

    Attributes:
        grids: Maps a and b, each in its own frame.
        T_a_b: (4, 4) true pose; None where both are of different places.
    """

    grids: tuple[VoxelGrid, VoxelGrid]
    T_a_b: np.ndarray | None
