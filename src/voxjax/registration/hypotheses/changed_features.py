"""Features of a map that was mirrored, or has another unit of length, made from those of the map in little time."""

from dataclasses import replace

import numpy as np

from ...maps.mirrored import mirrored, scaled
from ...maps.prepared import PreparedMap
from .map_features import MapFeatures

_MIRROR = np.asarray([-1.0, 1.0, 1.0])
"""What the mirror does to x, y and z."""


def mirrored_features(features: MapFeatures) -> MapFeatures:
    """Features of the mirror image of a map, in the image of its local frame: x is taken for -x.

    Args:
        features: Features of the map.
    """
    return _changed(
        features,
        mirrored(features.prepared),
        {factor: mirrored_features(copy) for factor, copy in features.coarser.items()},
        origin=features.origin * _MIRROR,
        directions=features.directions * _MIRROR,
        normals=features.normals * _MIRROR.astype(np.float32),
    )


def scaled_features(features: MapFeatures, factor: float) -> MapFeatures:
    """Features of a map in which all lengths are so many times as large.

    Args:
        features: Features of the map.
        factor: Above 0, and near enough to 1 for both maps to be compared at the voxel size of the other one.
    """
    coarser = {times: scaled_features(copy, factor) for times, copy in features.coarser.items()}
    return _changed(features, scaled(features.prepared, factor), coarser, origin=features.origin * factor)


def _changed(
    features: MapFeatures, prepared: PreparedMap, coarser: dict[int, MapFeatures], **parts: np.ndarray
) -> MapFeatures:
    """Features with another prepared map, whose corners and descriptors are made when asked for."""
    late = features.late.of(prepared.grid)
    return replace(features, prepared=prepared, late=late, coarser=coarser, **parts)
