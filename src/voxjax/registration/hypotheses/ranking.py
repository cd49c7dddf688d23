"""Quick ranking of any number of unrefined poses, and the choice of those that differ."""

import numpy as np
from jaxtyping import Float

from ... import rigid
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.scoring import score_poses

COARSE_CONFLICT_WEIGHT = 3.0
"""A conflict before refinement is less certain."""


def rank_poses(
    a: PreparedMap, b: PreparedMap, poses: Float[np.ndarray, "k 4 4"], *, num_points: int = 512
) -> Float[np.ndarray, "k"]:
    """Quick score of any number of unrefined poses: coarse tolerance, sampled voxels, sides ignored."""
    T = poses.astype(np.float32)
    total = np.zeros(len(poses), np.float32)
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    for target, other, direction in ((a, b, T), (b, a, rigid.inverse(T))):
        points = np.asarray(other.points)[sample_rows(other, num_points)]
        shares = score_poses(
            target.coarse_codes(target.coarse_factor), *target.block, points, weights, direction
        )
        total += np.asarray(shares) @ np.asarray([1.0, -COARSE_CONFLICT_WEIGHT, 0.0], np.float32)
    return total / 2


def distinct_poses(
    poses: np.ndarray,
    scores: np.ndarray,
    centroid: np.ndarray,
    *,
    metres: float,
    degrees: float,
    max_count: int,
) -> np.ndarray:
    """Indices of the best poses that differ in where they put the centroid of b, or in rotation; best first."""
    images = poses[:, :3, :3] @ centroid + poses[:, :3, 3]
    kept: list[int] = []
    bound = 1.0 + 2.0 * np.cos(np.radians(degrees))
    for i in np.argsort(-scores, kind="stable"):
        if kept:
            near = np.linalg.norm(images[kept] - images[i], axis=1) < metres
            traces = np.einsum("kij,ij->k", poses[kept, :3, :3], poses[i, :3, :3])
            if (near & (traces > bound)).any():
                continue
        kept.append(int(i))
        if len(kept) == max_count:
            break
    return np.asarray(kept, dtype=np.int64)
