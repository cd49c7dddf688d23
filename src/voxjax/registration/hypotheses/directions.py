"""Dominant directions of a map: where the normals of its surface point, whatever their sign."""

import numpy as np
from jaxtyping import Float

from .settings import RotationConfig


def dominant_directions(
    normals: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, "n"],
    *,
    settings: RotationConfig | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Peaks of the unsigned normals and the share of the weight near each.

    Args:
        normals: Unit rows; the sign does not matter.
        weights: Weight of each normal.
        settings: Who votes, what counts as near, and how many directions are kept; None for the defaults.

    Returns:
        float64 (k, 3) unit vectors and (k,) shares, strongest first.
    """
    chosen = RotationConfig() if settings is None else settings
    # The votes of all candidates are one table in memory: voters are thinned evenly, and candidates once more.
    stride = max(-(-len(normals) // chosen.max_voters), 1)
    normals, weights = normals[::stride], weights[::stride]
    total = float(weights.sum(dtype=np.float64))
    is_free = np.ones(len(normals), dtype=bool)
    seeds = normals[:: max(len(normals) // chosen.min_candidates, 1)]
    # As numbers: NumPy multiplies truth values element by element. In place: further tables
    # of this size take longer than the product.
    near = seeds @ normals.T
    np.abs(near, out=near)
    np.greater(near, np.cos(np.radians(chosen.vote_degrees)), out=near)
    directions, shares = [], []
    for _ in range(chosen.max_directions):
        if not is_free.any():
            break
        votes = near @ np.where(is_free, weights, 0.0).astype(np.float32)
        best = int(np.argmax(votes))
        if votes[best] < chosen.min_share * total:
            break
        # A few rounds of a weighted mean axis lead from the best candidate to the middle of its peak. The mean is an
        # eigenvector of the scatter, for which a normal and its opposite are the same.
        direction = seeds[best].astype(np.float64)
        for _ in range(5):
            angle = np.degrees(np.arccos(np.minimum(np.abs(normals @ direction), 1.0)))
            w = weights * np.exp(-0.5 * (angle / chosen.refining_degrees) ** 2) * is_free
            scatter = (normals * w[:, None]).T.astype(np.float64) @ normals
            direction = np.linalg.eigh(scatter)[1][:, -1]
        taken = np.abs(normals @ direction) > np.cos(np.radians(chosen.taken_degrees))
        directions.append(direction)
        shares.append(float(weights[taken & is_free].sum(dtype=np.float64)) / total)
        is_free &= ~taken
    return np.reshape(np.asarray(directions), (-1, 3)), np.asarray(shares)


def is_free_to_turn(
    directions: Float[np.ndarray, "k 3"], shares: Float[np.ndarray, "k"], settings: RotationConfig
) -> bool:
    """Whether hardly any surface of a map fixes a turn about its strongest direction.

    Args:
        directions: Dominant directions.
        shares: Share of the surface along each.
        settings: What counts as another direction, and how much surface fixes a turn.
    """
    if len(directions) == 0:
        return True
    best = int(np.argmax(shares))
    is_other = np.abs(directions @ directions[best]) <= np.cos(np.radians(settings.min_angle))
    return bool(shares[is_other].max(initial=0.0) < settings.min_second * shares[best])
