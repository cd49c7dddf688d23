"""Features of maps at the voxel size at which they are compared."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._checks import InputError
from .._runtime.mappings import release_kernels_if_crowded
from ..grid import VoxelGrid
from ..maps.main_part import main_part
from ..registration.hypotheses.map_features import MapFeatures, map_features
from ..registration.types import Registration
from .config import Config


class WorkingVoxel(NamedTuple):
    """The voxel size at which maps are compared.

    Attributes:
        size: Edge length [m].
        reason: Why this size, as words that follow it in a sentence.
    """

    size: float
    reason: str

    def noted(self, found: Registration) -> Registration:
        """A registration that says at which voxel size the maps were compared, and why."""
        return replace(found, stats=found.stats | {"voxel_size": self.size, "voxel_size_reason": self.reason})


def working_voxel(grids: Sequence[VoxelGrid], settings: Config) -> WorkingVoxel:
    """Voxel size at which maps are compared: the coarsest map's, after fine ones were made coarser.

    Args:
        grids: All maps that are compared with each other.
        settings: A voxel size, or how fine is too fine (`MapConfig`).
    """
    if settings.map.voxel_size > 0:
        return WorkingVoxel(settings.map.voxel_size, "as set by map.voxel_size")
    # Fine maps are made coarser first: beside one of 10 cm, maps of 4 cm must not ask for a size of their own.
    sizes = [_coarsened(grid, settings) for grid in grids]
    size = max(sizes)
    coarsest = grids[sizes.index(size)]
    factor = round(size / coarsest.voxel_size)
    if factor > 1:
        reason = f"{factor} voxels of a map that is finer than map.fine_voxel_size, {settings.map.fine_voxel_size:g} m"
    elif size < settings.map.fine_voxel_size:
        least = settings.map.min_surface
        reason = f"a map's own, for a coarser one would leave it fewer than {least:,} occupied voxels"
    else:
        reason = "that of the coarsest map"
    return WorkingVoxel(size, reason)


def _coarsened(grid: VoxelGrid, settings: Config) -> float:
    """Multiple of a map's voxel size that is about the usual one, where it is fine and shows enough surface."""
    if grid.voxel_size >= settings.map.fine_voxel_size:
        return grid.voxel_size
    # With a whole multiple each coarser voxel consists of equally many finer ones.
    factor = max(round(settings.map.usual_voxel_size / grid.voxel_size), 1)
    if settings.map.min_surface:
        # Occupied voxels are surfaces, which get fewer with the square of the factor.
        factor = min(factor, max(math.isqrt(grid.num_occupied // settings.map.min_surface), 1))
    return grid.voxel_size * factor


def features_at(grid: VoxelGrid, *, voxel_size: float, config: Config | None = None) -> MapFeatures:
    """Features of one map for all its pairs; of its main part, where pieces lie far away from all the rest.

    Args:
        grid: A map with at least one occupied voxel.
        voxel_size: Working voxel size [m] of all maps that it is compared with.
        config: Settings of the stages; None for the defaults.

    Raises:
        InputError: If nothing is occupied.
    """
    if grid.num_occupied == 0:
        raise InputError("grid must have at least one occupied voxel, got none; leave the map out.")
    settings = Config() if config is None else config
    # Before anything is made of the whole box, which a single stray may make a thousand times as large.
    part, num_isolated = main_part(grid)
    # Maps of ever new sizes bring ever new kernels, until the process has no memory mapping left for one.
    release_kernels_if_crowded()
    # Voxel sizes that went through float32 or text differ in their last digits; such maps are not resampled.
    same = abs(grid.voxel_size - voxel_size) < 1e-6 * voxel_size
    # Kernels see the map around zero, wherever it lies in its own frame.
    local, origin = (part if same else part.with_voxel_size(voxel_size)).localized()
    return features_of(local, origin, num_isolated, settings)


def features_of(
    local: VoxelGrid, origin: Float[np.ndarray, "3"], num_isolated: int, settings: Config
) -> MapFeatures:
    """`map_features` with the settings of all stages.

    Args:
        local: A map at the voxel size at which it is compared, in a frame in which it lies near zero.
        origin: Origin of that frame in the frame of the map [m].
        num_isolated: Occupied voxels that were left out of the map beforehand.
        settings: Settings of the stages.
    """
    return map_features(
        local,
        origin=origin,
        num_isolated=num_isolated,
        max_virtual=settings.source.max_virtual_corners,
        settings=settings.map,
        rotation=settings.rotation,
        plane=settings.plane,
    )
