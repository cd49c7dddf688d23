"""Keypoint baselines on occupied voxel centres: ISS and Harris in 3D.

ISS (Zhong 2009) is Open3D's where Open3D can be imported, otherwise the implementation here, which follows the same
definition. Harris3D follows PCL's: normals by principal components, the Harris response of their covariance, local
maxima, and positions refined to the point nearest to the neighbours' planes. Lengths are in voxels; all points are
voxels, so neighbours are looked up in a table of the grid.
"""

import importlib.util
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from voxjax import VoxelGrid

ISS_SALIENT_RADIUS, ISS_MAX_RADIUS, ISS_RATIO, ISS_FEWEST = 6.0, 4.0, 0.975, 5
"""Open3D's defaults, its unit, the spacing of the points, being the voxel."""

HARRIS_RADIUS = 5.0
"""PCL has one radius for normals, response and maxima; its default, 1 cm, is for other data [voxel]."""

_CHUNK = 8192
"""Voxels whose neighbours are held in memory at once."""


def iss_source() -> str:
    """Name of the implementation that `iss_keypoints` uses."""
    return "Open3D" if importlib.util.find_spec("open3d") else "bench.keypoints (Open3D is not installed)"


def iss_keypoints(grid: VoxelGrid) -> np.ndarray:
    """Intrinsic shape signatures: points (k, 3) [m] whose neighbours spread differently along all three axes."""
    if importlib.util.find_spec("open3d"):
        return _open3d_iss(grid)
    index = grid.occupied_index()
    values = _spread(index, ISS_SALIENT_RADIUS)[0]
    # Ascending: the ratios of the larger two and of the smaller two.
    is_distinct = (values[:, 1] < ISS_RATIO * values[:, 2]) & (values[:, 0] < ISS_RATIO * values[:, 1])
    saliency = np.where(is_distinct, values[:, 0], 0.0)
    return grid.world_from_index(index[_local_maxima(index, saliency, ISS_MAX_RADIUS, ISS_FEWEST)])


def _open3d_iss(grid: VoxelGrid) -> np.ndarray:
    """Keypoints by Open3D, with its defaults given in voxels."""
    import open3d

    geometry: Any = open3d.geometry
    cloud = geometry.PointCloud(open3d.utility.Vector3dVector(grid.occupied_points().astype(np.float64)))
    found = geometry.keypoint.compute_iss_keypoints(
        cloud,
        salient_radius=ISS_SALIENT_RADIUS * grid.voxel_size,
        non_max_radius=ISS_MAX_RADIUS * grid.voxel_size,
        gamma_21=ISS_RATIO,
        gamma_32=ISS_RATIO,
        min_neighbors=ISS_FEWEST,
    )
    return np.asarray(found.points)


def harris_keypoints(grid: VoxelGrid) -> np.ndarray:
    """Harris3D: points (k, 3) [m] where the normals around turn most."""
    index = grid.occupied_index()
    normal = _spread(index, HARRIS_RADIUS)[1][:, :, 0]
    point = index.astype(np.float64)
    outer = np.einsum("ni,nj->nij", normal, normal)
    height = np.einsum("ni,ni->n", normal, point)[:, None] * normal
    # Sums over the neighbours of n nᵀ, and of n nᵀ p for the refinement.
    features = np.concatenate([np.ones((len(index), 1)), outer.reshape(-1, 9), height], axis=1)
    sums = np.concatenate([rows @ features for rows in _neighbours(index, HARRIS_RADIUS)])
    matrix = sums[:, 1:10].reshape(-1, 3, 3)
    covariance = matrix / sums[:, :1, None]
    trace = np.trace(covariance, axis1=1, axis2=2)
    k = 0.04  # the weight of the trace, as in PCL
    response = k + np.linalg.det(covariance) - k * trace**2
    best = _local_maxima(index, response, HARRIS_RADIUS, 1)
    refined = point[best].copy()
    solvable = np.linalg.cond(matrix[best]) < 1e4
    rows = best[solvable]
    refined[solvable] = np.linalg.solve(matrix[rows], sums[rows, 10:, None])[..., 0]
    # Farther than its neighbourhood the refinement has left the keypoint.
    strayed = np.linalg.norm(refined - point[best], axis=1) > HARRIS_RADIUS
    refined[strayed] = point[best][strayed]
    return np.asarray(grid.origin, np.float64) + (refined + 0.5) * grid.voxel_size


def _neighbours(index: np.ndarray, radius: float) -> Iterator[csr_matrix]:
    """Matrices (chunk, n), one for each chunk of voxels: 1 where a voxel lies within `radius` of a chunk's, else 0."""
    reach = int(radius)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    steps = steps[np.einsum("ij,ij->i", steps, steps) <= radius**2]
    local = index - index.min(axis=0, initial=0) + reach
    shape = local.max(axis=0, initial=0) + reach + 1
    table = np.full(int(np.prod(shape)), -1, np.int32)
    strides = np.asarray([shape[1] * shape[2], shape[2], 1])
    cells = local @ strides
    table[cells] = np.arange(len(index), dtype=np.int32)
    for start in range(0, len(index), _CHUNK):
        found = table[cells[start : start + _CHUNK, None] + steps @ strides]
        is_there = found >= 0
        bounds = np.concatenate([[0], np.cumsum(np.count_nonzero(is_there, axis=1))])
        columns = found[is_there]
        yield csr_matrix((np.ones(len(columns)), columns, bounds), shape=(len(found), len(index)))


def _spread(index: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (n, 3), ascending, and eigenvectors (n, 3, 3), columns, of each voxel's neighbours."""
    # Centred before it is squared: else the covariance would be a small difference of large numbers.
    point = index.astype(np.float64) - index.mean(axis=0)
    products = np.einsum("ni,nj->nij", point, point).reshape(-1, 9)
    features = np.concatenate([np.ones((len(index), 1)), point, products], axis=1)
    sums = np.concatenate([rows @ features for rows in _neighbours(index, radius)])
    sums /= sums[:, :1]
    mean = sums[:, 1:4]
    values, vectors = np.linalg.eigh(sums[:, 4:].reshape(-1, 3, 3) - np.einsum("ni,nj->nij", mean, mean))
    return values, vectors


def _local_maxima(index: np.ndarray, score: np.ndarray, radius: float, fewest: int) -> np.ndarray:
    """Rows whose positive score no neighbour exceeds, with at least `fewest` neighbours; of ties the first."""
    rows = np.flatnonzero(score > 0.0)
    point = index.astype(np.float64)
    tree, kept = KDTree(point), []
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        for row, near in zip(part, tree.query_ball_point(point[part], radius), strict=True):
            best = np.asarray(near)[score[near] == score[near].max()]
            if len(near) >= fewest and row == best.min():
                kept.append(row)
    return np.asarray(kept, np.int64)
