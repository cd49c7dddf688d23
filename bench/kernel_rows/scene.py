"""Generated grids that the rows run on: storeys of rooms with doors and furniture, seen with drop-out and noise."""

import numpy as np

from voxjax._types import FREE, OCCUPIED


def rooms(side: int, seed: int = 0) -> np.ndarray:
    """States uint8 (side, side, side) of a building that fills the grid, about 4 % occupied, the rest free or unknown.

    Storeys are 40 voxels high and rooms 50 to 90 voxels wide, walls one or two voxels thick; 15 % of the surface
    is missing and one voxel in 10,000 is noise, as scans leave it.
    """
    rng = np.random.default_rng(seed)
    is_solid = np.zeros((side, side, side), bool)
    for axis in (0, 1):
        for at in np.cumsum(rng.integers(50, 91, side // 50)):
            if at < side - 2:
                wall = np.moveaxis(is_solid, axis, 0)[at : at + rng.integers(1, 3)]
                wall[:] = True
                for door in range(10, side - 12, 45):  # doors of ten by twenty voxels, one a storey
                    for floor in range(0, side, 40):
                        wall[:, door : door + 10, floor + 3 : floor + 25] = False
    for floor in range(2, side, 40):
        is_solid[:, :, floor] = True
    for _ in range(side**3 // 80_000):
        size = rng.integers(4, 14, 3)
        x, y = rng.integers(0, max(side - 14, 1), 2)
        floor = 40 * int(rng.integers(0, max(side // 40, 1))) + 3
        is_solid[x : x + size[0], y : y + size[1], floor : floor + size[2]] = True
    is_inner = np.zeros_like(is_solid)
    is_inner[1:-1, 1:-1, 1:-1] = True
    for axis in range(3):
        for step in (1, -1):
            is_inner &= np.roll(is_solid, step, axis)
    is_seen = is_solid & ~is_inner & (rng.random(is_solid.shape) > 0.15)
    is_seen |= rng.random(is_solid.shape) < 1e-4
    return np.where(is_seen, OCCUPIED, np.where(is_solid, np.uint8(0), FREE)).astype(np.uint8)
