"""Walls, floors and ceilings: the planes that much of a map lies on."""

import numpy as np
from jaxtyping import Bool, Int

from ..hypotheses.map_features import MapFeatures
from .settings import VerdictConfig


def lies_on_structure(
    features: MapFeatures, min_share: float = VerdictConfig.min_structure_share
) -> Bool[np.ndarray, "n"]:
    """Whether each occupied voxel lies on one of the planes that much of the map lies on: walls, floors, ceilings.

    Args:
        features: The map.
        min_share: Least share of the map's voxels on such a plane.
    """
    prepared = features.prepared
    count = prepared.num_points
    anchors, normals, planarity = (
        np.asarray(rows)[:count] for rows in (prepared.anchors, prepared.normals, prepared.planarity)
    )
    is_structure = np.zeros(count, bool)
    if len(features.directions) == 0:
        return is_structure
    directions = np.asarray(features.directions, np.float32)
    cosine = np.abs(normals @ directions.T)
    nearest = np.argmax(cosine, axis=1)
    # Planes along a direction are told apart by their offsets; 18 degrees are what normals of voxels are off.
    is_planar = (np.take_along_axis(cosine, nearest[:, None], axis=1)[:, 0] > 0.95) & (planarity > 0.3)
    for number, direction in enumerate(directions):
        rows = np.flatnonzero(is_planar & (nearest == number))
        if len(rows):
            offset = np.rint(anchors[rows] @ direction / prepared.grid.voxel_size).astype(np.int64)
            is_structure[rows] = _num_beside(offset - offset.min()) > min_share * count
    return is_structure


def _num_beside(offset: Int[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """How many offsets are each one's or its neighbours': a plane between two whole numbers is on both."""
    counts = np.bincount(offset, minlength=offset.max() + 3)
    around = counts.copy()
    around[1:] += counts[:-1]
    around[:-1] += counts[1:]
    return around[offset]
