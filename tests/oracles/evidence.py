"""Evidence, nearest voxels and correlation scores from their definitions, by loops and brute force."""

import numpy as np


def nearest_brute_force(index, dims, radius):
    """Squared distance and row of the nearest listed voxel, or (63, -1) beyond the radius; lowest row on ties."""
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in dims), indexing="ij"), -1).reshape(-1, 3)
    squared = ((cells[:, None, :] - index[None, :, :]) ** 2).sum(-1)
    row = squared.argmin(1)
    best = squared[np.arange(len(cells)), row]
    is_far = best > radius * radius
    return np.where(is_far, 63, best), np.where(is_far, -1, row)


def evidence_of_point(states, origin, voxel_size, point, hit_sq, clear_sq):
    """'hit', 'conflict', 'neutral' or 'nothing' for one point, by looking at every occupied voxel."""
    cell = np.floor((point - origin) / voxel_size).astype(int)
    if (cell < 0).any() or (cell >= states.shape).any():
        return "nothing"
    occupied = np.argwhere(states == 2)
    nearest = ((occupied - cell) ** 2).sum(1).min() if len(occupied) else 10**9
    if nearest <= hit_sq:
        return "hit"
    if states[tuple(cell)] != 1:
        return "nothing"
    return "conflict" if nearest >= clear_sq else "neutral"


def shifted_score(offer_a, ask_a, offer_b, ask_b, shift):
    """sum offer_a(x + t) ask_b(x) + ask_a(x + t) offer_b(x), with periodic arrays."""
    back = tuple(-s for s in shift)
    rolled_offer = np.roll(offer_a, back, axis=(0, 1, 2))
    rolled_ask = np.roll(ask_a, back, axis=(0, 1, 2))
    return float((rolled_offer * ask_b + rolled_ask * offer_b).sum())
