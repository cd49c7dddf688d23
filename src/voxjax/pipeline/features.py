"""Features of maps at the voxel size at which they are compared."""

from collections.abc import Sequence

from .._checks import InputError
from .._runtime.mappings import release_kernels_if_crowded
from ..grid import VoxelGrid
from ..registration.hypotheses.map_features import MapFeatures, map_features
from .config import Config

FINE_VOXEL = 0.075
"""Maps finer than this [m] are brought to about 0.1 m: the trials behind the evidence ran there."""


def working_voxel_size(grids: Sequence[VoxelGrid], settings: Config) -> float:
    """Voxel size [m] at which maps are compared: the coarsest map's, after fine ones are brought to about 0.1 m."""
    if settings.map.voxel_size > 0:
        return settings.map.voxel_size
    sizes = [
        g.voxel_size * (max(round(0.1 / g.voxel_size), 1) if g.voxel_size < FINE_VOXEL else 1) for g in grids
    ]
    return max(sizes)


def features_at(
    grid: VoxelGrid, *, voxel_size: float, max_virtual: int = 256, infer_free_space: bool = True
) -> MapFeatures:
    """Features of one map for all its pairs.

    Args:
        grid: With at least one occupied voxel.
        voxel_size: Working voxel size [m] of all maps that it is compared with.
        max_virtual: Largest number of virtual corners.
        infer_free_space: Take what surfaces enclose for free where the map records no free space.

    Raises:
        InputError: If nothing is occupied.
    """
    if grid.num_occupied == 0:
        raise InputError("grid must have at least one occupied voxel, got none; leave the map out.")
    release_kernels_if_crowded()
    same = abs(grid.voxel_size - voxel_size) < 1e-6 * voxel_size
    return map_features(
        grid if same else grid.with_voxel_size(voxel_size),
        max_virtual=max_virtual,
        infer_free_space=infer_free_space,
    )
