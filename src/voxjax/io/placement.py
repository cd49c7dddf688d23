"""A map at other places than its file says: in another unit of length, and moved; nothing is resampled for that."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from .._checks import LARGEST_LENGTH, InputError, as_float64, check_positive, shown
from ..grid import VoxelGrid
from ..maps.isolated import IsolatedPieces
from .clouds import Cloud
from .crop import check_crop
from .spacing import Spacing


class Placement(NamedTuple):
    """Where what a file holds shall lie: its positions times `scale`, and then moved by `shift`.

    Attributes:
        scale: Factor of all lengths, above 0.
        shift: float64 (3,) [m], in the unit of the result.
    """

    scale: float
    shift: Float64[np.ndarray, "3"]

    def of_points(self, points: np.ndarray) -> np.ndarray:
        """Places float64 (..., 3), whatever precision they had."""
        return np.asarray(points, np.float64) * self.scale + self.shift

    def of_cloud(self, cloud: Cloud) -> Cloud:
        """A cloud with its sensors."""
        origins = cloud.sensor_origins
        # Sensors of another shape are refused by what casts the rays.
        if origins is not None and origins.shape[-1:] == (3,):
            origins = self.of_points(origins)
        return cloud._replace(points=self.of_points(cloud.points), sensor_origins=origins)

    def of_crop(self, crop: object) -> object:
        """A box, which may be None."""
        return None if crop is None else self.of_points(np.stack(check_crop(crop)))

    def of_spacing(self, spacing: Spacing) -> Spacing:
        """How far apart the points of the placed cloud lie."""
        lattice = None if spacing.lattice is None else spacing.lattice * self.scale
        return Spacing(spacing.closing * self.scale, spacing.nearest * self.scale, lattice)

    def of_pieces(self, pieces: IsolatedPieces) -> IsolatedPieces:
        """Isolated pieces of the placed map."""
        return pieces._replace(
            distance=pieces.distance * self.scale,
            low=self.of_points(pieces.low),
            high=self.of_points(pieces.high),
            sides=pieces.sides * self.scale,
            voxel_size=pieces.voxel_size * self.scale,
        )

    def of_grid(self, grid: VoxelGrid) -> VoxelGrid:
        """The same voxels, which are wider or narrower, and elsewhere."""
        return grid.placed(scale=self.scale, shift=self.shift)


def check_placement(scale: object, shift: object) -> Placement | None:
    """What was asked for; None where that leaves all places as they are.

    Args:
        scale: Factor of all lengths.
        shift: Three numbers [m].

    Raises:
        InputError: If the factor is no finite number above 0, or the shift not three finite numbers.
    """
    factor = check_positive("scale", scale)
    try:
        move = as_float64(shift)
    except (TypeError, ValueError):
        move = np.zeros(0)
    if move.shape != (3,) or not (np.abs(move) <= LARGEST_LENGTH).all():  # NaN is not, too
        raise InputError(
            f"shift must be three numbers x, y, z within {LARGEST_LENGTH:g} m, got {shown(shift)}."
        )
    return None if factor == 1.0 and not move.any() else Placement(factor, move)
