"""True corners that a map shows."""

import numpy as np
from scipy.spatial import KDTree

from .. import rigid
from .._types import FREE
from ..grid import VoxelGrid
from .true_corners import TrueCorners


def observed_corners(corners: TrueCorners, grid: VoxelGrid, T_world_map: np.ndarray | None) -> np.ndarray:
    """Whether each corner has occupied voxels on all three faces beside it, and free space.

    Args:
        corners: True corners in the frame of the world.
        grid: The map.
        T_world_map: (4, 4); None for a map of another place, which shows none.

    Returns:
        bool (n,).
    """
    seen = np.zeros(len(corners.kind), bool)
    if T_world_map is None or not grid.num_occupied:
        return seen
    T_map_world = rigid.inverse(T_world_map)
    position = corners.position @ T_map_world[:3, :3].T + T_map_world[:3, 3]
    normals = corners.normals @ T_map_world[:3, :3].T
    points = grid.occupied_points().astype(np.float64)
    # How far along its faces a corner is looked at [m]; coarse maps need a few voxels of them.
    reach = max(0.35, 4.0 * grid.voxel_size)
    nearby = KDTree(points).query_ball_point(position, reach)
    for i, indices in enumerate(nearby):
        seen[i] = _shows_faces(points[indices] - position[i], normals[i], grid.voxel_size)
    # The sum of the normals leads away from all three faces, to where the space before the corner was seen as free.
    for i in np.flatnonzero(seen):
        probe = grid.index_from_world((position[i] + 0.6 * reach * normals[i].sum(axis=0))[None])[0]
        low, high = (np.clip(probe + step, 0, grid.shape) for step in (-2, 3))
        seen[i] = (grid.states_in(low, high) == FREE).any()
    return seen


def _shows_faces(offsets: np.ndarray, normals: np.ndarray, voxel_size: float) -> bool:
    """Whether each face has voxels within one voxel of its plane and farther from both others."""
    fewest_voxels = 3
    distance = np.abs(offsets @ normals.T)
    is_near = distance < voxel_size
    # A voxel near two planes lies on their edge, and shows neither face.
    alone = is_near & (is_near.sum(axis=1, keepdims=True) == 1)
    return bool((alone.sum(axis=0) >= fewest_voxels).all())
