"""The paper's corners: sliding window, plane rejection, clustering (section III), nothing added."""

from typing import NamedTuple

import numpy as np

from ..grid import VoxelGrid
from ..planes.fit import Planes, fit_planes
from ..planes.grow import segment_planes
from ..planes.reject import reject_corners
from ..planes.surface import Surface, find_surface
from .classify import CORNER, classify_voxels
from .cluster import cluster_corners
from .observed import right_handed
from .types import KIND_UNKNOWN, Corners


class PaperStages(NamedTuple):
    """What each step of section III gives, for tables and pictures.

    Attributes:
        initial: float32 (n, 3) [m]: initial feature points of the window.
        planes: `Planes` fitted to the grown segments.
        kept: float32 (m, 3) [m]: those within the threshold of their nearest three planes.
        corners: One corner of each cluster.
    """

    initial: np.ndarray
    planes: Planes
    kept: np.ndarray
    corners: Corners


def paper_corners(
    grid: VoxelGrid,
    *,
    size: int = 7,
    min_change: int = 20,
    max_angle: float = 5.0,
    max_curvature: float = 0.2,
    min_segment: int = 30,
    plane_distance_tolerance: float = 1.5,
    cluster_radius: float = 3.0,
) -> PaperStages:
    """Extract corners as section III does.

    Args:
        grid: The map.
        size: Window edge [voxel] (the paper: 7).
        min_change: Significant change of the count [per cent].
        max_angle: Smoothness threshold of the region growing [degree].
        max_curvature: Curvature threshold of the region growing.
        min_segment: Segments with fewer elements give no plane.
        plane_distance_tolerance: The epsilon of equation (3) [voxel].
        cluster_radius: Corners within this of a better one join its cluster [voxel].

    Returns:
        `PaperStages`; the position of a corner is that of a voxel, as in the paper.
    """
    voxel = grid.voxel_size
    kinds = np.asarray(classify_voxels(np.asarray(grid.states) == 2, size=size, min_change=min_change))
    initial = grid.world_from_index(np.argwhere(kinds == CORNER)).astype(np.float32)
    surface = find_surface(grid, size=size)
    labels = segment_planes(
        surface, max_angle=max_angle, max_curvature=max_curvature, min_elements=min_segment
    )
    planes, support = _fit(grid, surface, labels)
    normal, offset = np.asarray(planes.normal), np.asarray(planes.offset)
    # Equation (3) keeps the corners that lie on three planes.
    keep, rows, worst = reject_corners(
        initial,
        normal,
        offset,
        support,
        labels,
        max_distance=plane_distance_tolerance * voxel,
        # Planes count that have a voxel within about a window of the corner: the paper says only that they are
        # the nearest.
        support_radius=float(size) * voxel,
    )
    kept, rows = initial[keep], rows[keep]
    # The paper does not say which corner of a cluster stays; here the one nearest to its three planes does.
    _, chosen = cluster_corners(kept, -worst[keep], radius=cluster_radius * voxel)
    # A corner is as strong as the smallest of its planes.
    count = np.asarray(planes.num_voxels)[rows[chosen]].min(axis=1, initial=2**31 - 1)
    order = np.argsort(-count, kind="stable")
    chosen, count = chosen[order], count[order]
    corners = Corners(
        position=kept[chosen],
        normals=right_handed(normal[rows[chosen]]).astype(np.float32),
        weight=(np.sqrt(count.astype(np.float64)) * voxel).astype(np.float32),
        convexity=np.full(len(chosen), KIND_UNKNOWN, np.uint8),
        mask=np.ones(len(chosen), bool),
        is_observed=np.ones(len(chosen), bool),
        num_found=np.asarray(len(chosen), np.int32),
        # The voxel may lie anywhere within the tolerance of its three planes.
        covariance=np.tile(_voxel_covariance(plane_distance_tolerance * voxel), (len(chosen), 1, 1)),
    )
    return PaperStages(initial, planes, kept, corners)


def _voxel_covariance(reach: float) -> np.ndarray:
    """Covariance [m^2] of a position that is even within `reach` [m] along each axis."""
    return np.eye(3, dtype=np.float32) * np.float32(reach**2 / 3.0)


def _fit(grid: VoxelGrid, surface: Surface, labels: np.ndarray) -> tuple[Planes, np.ndarray]:
    """Planes of the segments, and the elements' places [m]."""
    points = grid.world_from_index(surface.index).astype(np.float32)
    return fit_planes(points, labels, normals=surface.normal), points
