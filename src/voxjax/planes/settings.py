"""Settings of the planes of a map."""

import dataclasses

from .._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class PlaneConfig(Settings, table="plane"):
    """How planes are found that corners are made from; the paper gives no values but the window.

    Attributes:
        window_radius: How far from a voxel the window for its normal reaches [voxel]; less than the paper's 3, so that
            the faces of furniture a few voxels wide keep normals of their own.
        max_angle: Smoothness threshold of the growth [deg].
        max_curvature: Curvature threshold of the growth; a last pass with twice the value takes up thick walls.
        tolerance: Elements of a plane lie within this of it [voxel].
        max_rms: A segment with a larger rms distance is not a plane [voxel].
        merge_angle: Largest angle between planes that are merged [deg].
        gap: Pieces of one plane farther apart than about this stay apart [voxel].
        min_voxels: Smallest plane [voxel].
        min_width: Narrower segments are no faces but the rounded edges between two [voxel].
        chamfer_reach: Segments that keep within this of the edge of two others are no faces either [voxel].
        max_planes: At most so many planes, the largest.
    """

    window_radius: int = setting(2, low=1, high=12)
    max_angle: float = setting(15.0, low=0.0, high=90.0)
    max_curvature: float = setting(0.12, low=0.0, high=1.0)
    tolerance: float = setting(1.0, above=0.0, high=1_000.0)
    max_rms: float = setting(0.7, above=0.0, high=1_000.0)
    merge_angle: float = setting(6.0, low=0.0, high=90.0)
    gap: float = setting(10.0, low=1.0, high=1_000.0)
    min_voxels: int = setting(15, low=1, high=1_000_000)
    min_width: float = setting(3.5, low=0.0, high=1_000.0)
    chamfer_reach: float = setting(4.0, low=1.0, high=1_000.0)
    max_planes: int = setting(512, low=1, high=100_000)
