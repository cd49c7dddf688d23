"""`MapFeatures`: what the hypotheses of a map's pairs are made from, computed once a map."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float, Float32

from ..features.corners import corners_of_planes
from ..features.types import Corners
from ..grid import VoxelGrid
from ..matching.descriptors import MapDescriptors, describe_map
from ..planes.extract import PlaneMap, extract_planes
from . import prepared as prepared_maps
from .prepared import PreparedMap, prepare_map
from .rotations import dominant_directions, sample_normals

DIRECTION_PLANARITY = 0.5
"""Voxels at least so planar vote for directions."""


class MapFeatures(eqx.Module):
    """One map with its fields, corners and directions.

    Attributes:
        prepared: Fields and surface.
        corners: Observed and virtual corners.
        directions: Dominant unsigned normals, strongest first.
        shares: Share of the surface along each.
        normals: Normals drawn by leverage, that rotations are judged by.
        descriptors: Local descriptors; None where they were not asked for.
    """

    prepared: PreparedMap
    corners: Corners
    directions: Float[np.ndarray, "k 3"]
    shares: Float[np.ndarray, "k"]
    normals: Float32[np.ndarray, "s 3"]
    descriptors: MapDescriptors | None


def map_features(grid: VoxelGrid, *, max_virtual: int, with_descriptors: bool = True) -> MapFeatures:
    """Compute the features of a map that has occupied voxels.

    Args:
        grid: At the working voxel size.
        max_virtual: Largest number of virtual corners.
        with_descriptors: Whether local descriptors are computed.
    """
    prepared = prepare_map(grid)
    count = prepared.num_points
    normals, planarity = np.asarray(prepared.normals)[:count], np.asarray(prepared.planarity)[:count]
    leverage = planarity.astype(np.float64) * np.asarray(prepared.weights)[:count]
    is_planar = planarity > DIRECTION_PLANARITY
    directions, shares = dominant_directions(normals[is_planar], planarity[is_planar])
    plane_map: PlaneMap = extract_planes(prepared.grid)
    return MapFeatures(
        prepared=prepared,
        corners=corners_of_planes(prepared.grid, plane_map, virtual=True, max_virtual=max_virtual),
        directions=directions,
        shares=shares,
        normals=sample_normals(normals, leverage if leverage.sum() > 0 else np.ones(count)),
        descriptors=describe(prepared, use_free_space=prepared.has_free_space) if with_descriptors else None,
    )


def share_sizes(features: Sequence[MapFeatures]) -> list[MapFeatures]:
    """The same features with arrays of one size (`prepared.share_sizes`)."""
    padded = prepared_maps.share_sizes([f.prepared for f in features])
    return [eqx.tree_at(lambda m: m.prepared, f, p) for f, p in zip(features, padded, strict=True)]


def describe(prepared: PreparedMap, *, use_free_space: bool) -> MapDescriptors:
    """Local descriptors of a map; both maps of a pair must agree on whether free space signs their normals."""
    return describe_map(prepared.grid, use_free_space=use_free_space)
