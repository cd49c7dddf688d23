"""Corner lists for the tests of matching and registration."""

import numpy as np

from oracles.motions import moved, random_pose
from voxjax.features.types import KIND_UNKNOWN, Corners


def corners_at(points, frames=None, mask=None, convexity=None):
    """Corners at points [m], with axis-parallel frames unless given."""
    count = len(points)
    axes = np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
    return Corners(
        position=np.asarray(points, np.float32),
        normals=axes if frames is None else frames.astype(np.float32),
        weight=np.ones(count, np.float32),
        convexity=np.full(count, KIND_UNKNOWN, np.uint8) if convexity is None else convexity,
        mask=np.ones(count, bool) if mask is None else mask,
        is_observed=np.ones(count, bool),
        num_found=np.asarray(count, np.int32),
    )


def clouds(seed, n, m, shared, noise=0.0):
    """Corners of two maps that share the first `shared`, in frames that differ by a rigid motion."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 10, (n, 3)), rng.uniform(0, 10, (m, 3))
    T = random_pose(rng)
    b[:shared] = moved(
        np.linalg.inv(T), a[:shared] + rng.normal(0, noise, (shared, 3)) if noise else a[:shared]
    )
    return a.astype(np.float32), b.astype(np.float32), T
