"""What a sensor can meet in a generated world: solids, rolling ground, and how both are bent."""

from dataclasses import dataclass

import numpy as np

from .._runtime.buckets import bucket_size, pad_rows
from .ground import Ground
from .prisms import Prisms, cast_rays
from .warp import Warp


@dataclass(frozen=True)
class Scene:
    """A world as rays see it.

    Attributes:
        solids: Upright prisms.
        ground: Rolling ground, None where solids are the floor.
        warp: By how much what is seen lies off the straight faces of the solids; None for not at all.
    """

    solids: Prisms
    ground: Ground | None = None
    warp: Warp | None = None

    def ranges(self, origin: np.ndarray, directions: np.ndarray, max_range: float) -> np.ndarray:
        """Distances (n,) [m] from one origin along unit vectors (n, 3) to what is met first.

        Farther than `max_range` [m] they are not below it, but may be too long, for solids that far are left out.
        """
        near = self.solids.within(origin, max_range)
        found = measure_ranges(near, origin, directions)
        if self.ground is not None:
            found = np.minimum(found, self.ground.ranges(origin, directions, max_range))
        return found


def measure_ranges(solids: Prisms, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distances (n,) [m] from one origin to the nearest solid along unit vectors, inf without echo."""
    # Sizes climb the ladder, so that worlds of all numbers of solids share few compiled casters.
    size = bucket_size(len(solids.kind))
    arrays = (solids.side_normals, solids.side_offsets, solids.z_range)
    padded = [pad_rows(array.astype(np.float32), size) for array in arrays]
    mask = np.arange(size) < len(solids.kind)
    ranges = cast_rays(origin.astype(np.float32), directions.astype(np.float32), *padded, mask)
    return np.asarray(ranges, np.float64)
