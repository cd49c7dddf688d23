"""Quick ranking of any number of unrefined poses."""

import numpy as np
from jaxtyping import Float

from ... import rigid
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.scoring import score_poses


def rank_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int,
    conflict_weight: float,
) -> Float[np.ndarray, "k"]:
    """Quick score of any number of unrefined poses: coarse tolerance, sampled voxels, sides ignored.

    Args:
        a: First map.
        b: Second map.
        poses: `T_a_b` candidates.
        num_points: Voxels of each map to look at.
        conflict_weight: How many hits a conflict outweighs.
    """
    T = poses.astype(np.float32)
    total = np.zeros(len(poses), np.float32)
    # Points are drawn by leverage, and therefore all count the same.
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    # Both ways count: where surfaces of a lie in free space of b, only the second way shows it.
    for target, other, direction in ((a, b, T), (b, a, rigid.inverse(T))):
        points = np.asarray(other.points)[sample_rows(other, num_points)]
        shares = score_poses(target.coarse_codes(), target.block, points, weights, direction)
        # The shares are of hits, of conflicts, and of what is undecided, which says nothing.
        total += np.asarray(shares) @ np.asarray([1.0, -conflict_weight, 0.0], np.float32)
    return total / 2
