"""Quick refinement of any number of poses: points of one map onto the surface of the other."""

import numpy as np
from jaxtyping import Float

from ..._runtime.placement import to_device
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.align import align_poses


def refine_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int,
    num_steps: int,
    start_distance: float,
    final_distance: float,
) -> Float[np.ndarray, "k 4 4"]:
    """Align each pose, b onto the surface of a; distances are robust scales [voxel]."""
    rows = sample_rows(b, num_points)
    # Points are drawn by leverage, and therefore all count the same.
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    points = np.asarray(b.points)[rows]
    start, final = to_device((np.float32(start_distance), np.float32(final_distance)))
    refined = align_poses(
        a.keys,
        a.block,
        a.points,
        a.normals,
        points,
        weights,
        poses.astype(np.float32),
        num_steps=num_steps,
        start_distance=start,
        final_distance=final,
    )
    return np.asarray(refined)
