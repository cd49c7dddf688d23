"""Maps of hundreds of metres: coarser copies, in which poses are looked for before they are judged in fine voxels."""

import dataclasses

import numpy as np

from ..registration.hypotheses.exhaustive import upright_frame, upright_sides
from ..registration.hypotheses.map_features import MapFeatures
from .config import Config
from .features import features_of


def needed_coarsening(a: MapFeatures, b: MapFeatures, settings: Config) -> int:
    """How many times as wide voxels must be for the exhaustive search to be affordable; 1 for most maps.

    Args:
        a: First map.
        b: Second map.
        settings: How wide the cells of the search may be, and how many a block may have.
    """
    cell = settings.exhaustive.max_factor * a.prepared.grid.voxel_size
    # A block of the search is as wide as both maps beside each other, which lie alike, for normals turn them.
    sides = sum(upright_sides(each.prepared, upright_frame(each.directions, each.shares)) for each in (a, b))
    factor = 1
    while np.ceil(np.asarray(sides) / (factor * cell)).prod() > settings.exhaustive.most_cells:
        factor += 1
    return factor


def coarser_features(features: MapFeatures, factor: int, settings: Config) -> MapFeatures:
    """Features of a map in voxels `factor` times as wide, in the same local frame; made once for all pairs of the map.

    Args:
        features: Features at the working voxel size.
        factor: A whole number above 1.
        settings: Settings of the stages.
    """
    if factor not in features.coarser:
        grid = features.prepared.grid
        found = features_of(grid.with_voxel_size(factor * grid.voxel_size), features.origin, 0, settings)
        # Free space that was inferred in fine voxels is still inferred.
        features.coarser[factor] = dataclasses.replace(found, free_space=features.free_space)
    return features.coarser[factor]
