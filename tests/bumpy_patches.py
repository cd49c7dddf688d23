"""Points on a bumpy surface, and their descriptors, for the tests of descriptors."""

import numpy as np

from voxjax.ops.descriptors.fpfh import point_feature_histograms
from voxjax.ops.descriptors.tiles import near_tiles, point_tree


def bumpy_patch(seed=0, n=60):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-1, 1, (n, 2))
    points = np.c_[xy, 0.3 * np.sin(3 * xy[:, 0]) + 0.05 * rng.normal(size=n)].astype(np.float32)
    normals = rng.normal(size=(n, 3)) + np.array([0.0, 0.0, 2.0])
    return points, (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def near(points, radius):
    return near_tiles(point_tree(points), radius)


def describe(points, normals, radius=0.6, **options):
    return np.asarray(
        point_feature_histograms(points, normals, near(points, radius), radius=radius, spacing=0.2, **options)
    )
