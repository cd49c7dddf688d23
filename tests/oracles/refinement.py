"""Residuals of the refinement from their definitions, point by point in float64; imports nothing of the library."""

import numpy as np


def loss_of(squared, loss):
    """Robust loss of a squared offset in units of the robust scale."""
    return {
        "geman_mcclure": squared / (1 + squared),
        "cauchy": np.log1p(squared),
        "huber": squared if squared < 1 else 2 * np.sqrt(squared) - 1,
        "squared": squared,
    }[loss]


def trilinear(values, outside, place):
    """Value at a place [voxel, from the outer corner] between the centres of a dense grid."""
    low = np.floor(np.asarray(place) - 0.5).astype(int)
    high = np.asarray(place) - 0.5 - low
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        cell = low + corner
        inside = ((cell >= 0) & (cell < values.shape)).all()
        share = np.prod([h if c else 1 - h for c, h in zip(corner, high, strict=True)])
        total += share * (values[tuple(cell)] if inside else outside)
    return total


def distance_from_plane(centre, anchor, normal, is_signed, voxel_size, reach):
    """Distance of a voxel centre from a piece of plane one voxel wide around an anchor."""
    gap = np.asarray(centre, float) - anchor
    across = gap @ normal
    if not is_signed:
        return min(np.linalg.norm(gap), reach)
    beyond = max(np.linalg.norm(gap - across * normal) - voxel_size, 0.0)
    return float(np.clip(np.sign(across) * np.hypot(across, beyond), -reach, reach))
