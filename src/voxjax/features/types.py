"""`Corners`: where three faces of a map meet."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt8

from .._types import Array

KIND_UNKNOWN = 255
"""`Corners.convexity` of corners whose faces were not seen beside the point; may match any kind."""


class Corners(eqx.Module):
    """Corners of a map, strongest first, padded to a capacity; rows beyond the found ones are masked.

    Attributes:
        position: float64 (n, 3) [m] in the map's frame.
        normals: float32 (n, 3, 3): unit rows into free space, in right-handed order (positive triple
            product), so that two corners can only match in one of three cyclic orders. Where convexity is 1
            or 2, row 0 is the face that differs from the two others.
        weight: float32 (n,): how well supported [m]: the smallest root of the three planes' areas, less for
            planes that are far away or meet at a flat angle.
        convexity: uint8 (n,): number of convex edges: 0 corner of a room, 1 foot of a box, 2 corner of an
            opening, 3 corner of a box top; 255 not known.
        mask: bool (n,): rows that hold a corner.
        is_observed: bool (n,): voxels of all three faces lie beside the point; else the planes meet there
            unseen.
        num_found: int32 scalar: corners found, which may be more than are listed.
        covariance: float32 (n, 3, 3) [m^2]: of the position, 0 in padding rows; None for lists made without it.
    """

    position: Float[Array, "n 3"]
    normals: Float32[Array, "n 3 3"]
    weight: Float32[Array, "n"]
    convexity: UInt8[Array, "n"]
    mask: Bool[Array, "n"]
    is_observed: Bool[Array, "n"]
    num_found: Int32[Array, ""]
    covariance: Float32[Array, "n 3 3"] | None = None

    @property
    def num_listed(self) -> int:
        """Number of rows that hold a corner."""
        return int(np.count_nonzero(np.asarray(self.mask)))

    def trimmed(self) -> "Corners":
        """The listed corners only, on the host."""
        keep = np.asarray(self.mask)
        rows = (self.position, self.normals, self.weight, self.convexity, self.mask, self.is_observed)
        covariance = None if self.covariance is None else np.asarray(self.covariance)[keep]
        return Corners(
            *(np.asarray(a)[keep] for a in rows), num_found=np.asarray(self.num_found), covariance=covariance
        )
