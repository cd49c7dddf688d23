"""Features of points for the peers that match them: FPFH by Open3D, and matches that are mutually nearest."""

import importlib
from typing import Any

import numpy as np
from scipy.spatial import KDTree


def fpfh(points: np.ndarray, working: float) -> tuple[Any, Any]:
    """Open3D's cloud of the points (n, 3), downsampled to the working voxel, and its FPFH features.

    Normals are of at most 30 neighbours within 2 working voxels, features of at most 100 within 5.
    """
    o3d: Any = importlib.import_module("open3d")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    cloud = cloud.voxel_down_sample(working)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * working, max_nn=30))
    around = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * working, max_nn=100)
    return cloud, o3d.pipelines.registration.compute_fpfh_feature(cloud, around)


def mutual_matches(features_b: np.ndarray, features_a: np.ndarray, *, most: int) -> np.ndarray:
    """Rows of features (n, d) and (m, d) that are each other's nearest, (k, 2): the `most` nearest ones, in order."""
    if not len(features_b) or not len(features_a):
        return np.empty((0, 2), np.int64)
    distances, of_b = _nearest(features_b, features_a)
    _, of_a = _nearest(features_a, features_b)
    rows = np.flatnonzero(of_a[of_b] == np.arange(len(of_b)))
    rows = rows[np.argsort(distances[rows], kind="stable")[:most]]
    return np.stack([rows, of_b[rows]], axis=1)


def _nearest(features: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each row to the nearest of the others, and the number of that one."""
    distances, rows = KDTree(others).query(features, workers=-1)
    return np.asarray(distances), np.asarray(rows)
