"""Dominant directions of a map: where the normals of its surface point, whatever their sign."""

import numpy as np
from jaxtyping import Float

from .settings import RotationConfig


def dominant_directions(
    normals: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, "n"],
    *,
    max_voters: int = RotationConfig.max_voters,
    max_directions: int = RotationConfig.max_directions,
    min_share: float = RotationConfig.min_share,
) -> tuple[np.ndarray, np.ndarray]:
    """Peaks of the unsigned normals and the share of the weight within 10 degrees of each.

    Args:
        normals: Unit rows; the sign does not matter.
        weights: Weight of each normal.
        max_voters: Normals that vote at most, evenly chosen.
        max_directions: Directions at most, the strongest first.
        min_share: Directions with less than this share of the weight are left out.

    Returns:
        float64 (k, 3) unit vectors and (k,) shares.
    """
    stride = max(-(-len(normals) // max_voters), 1)
    normals, weights = normals[::stride], weights[::stride]
    total = float(weights.sum(dtype=np.float64))
    is_free = np.ones(len(normals), dtype=bool)
    seeds = normals[:: max(len(normals) // 400, 1)]
    # As numbers: NumPy multiplies truth values element by element.
    near = (np.abs(seeds @ normals.T) > np.cos(np.radians(8.0))).astype(np.float32)
    directions, shares = [], []
    for _ in range(max_directions):
        if not is_free.any():
            break
        votes = near @ np.where(is_free, weights, 0.0).astype(np.float32)
        best = int(np.argmax(votes))
        if votes[best] < min_share * total:
            break
        direction = seeds[best].astype(np.float64)
        for _ in range(5):
            angle = np.degrees(np.arccos(np.minimum(np.abs(normals @ direction), 1.0)))
            w = weights * np.exp(-0.5 * (angle / 4.0) ** 2) * is_free
            scatter = (normals * w[:, None]).T.astype(np.float64) @ normals
            direction = np.linalg.eigh(scatter)[1][:, -1]
        # Wider than the votes, so that the slopes of a peak do not become a direction of their own.
        taken = np.abs(normals @ direction) > np.cos(np.radians(10.0))
        directions.append(direction)
        shares.append(float(weights[taken & is_free].sum(dtype=np.float64)) / total)
        is_free &= ~taken
    return np.reshape(np.asarray(directions), (-1, 3)), np.asarray(shares)
