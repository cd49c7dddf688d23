"""Corner lists for the tests of matching and registration."""

import numpy as np

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
