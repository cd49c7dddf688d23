"""Window counts and their changes from the definition, with loops and an endless grid of empty voxels."""

import itertools

import numpy as np


def window_count(occupied, size):
    """Occupied voxels in the cube around each voxel, by adding shifted copies."""
    half = size // 2
    padded = np.pad(np.asarray(occupied, np.int64) != 0, half).astype(np.int64)
    count = np.zeros(occupied.shape, np.int64)
    for shift in itertools.product(range(size), repeat=3):
        window = tuple(slice(s, s + n) for s, n in zip(shift, occupied.shape, strict=True))
        count += padded[window]
    return count


def count_at(occupied, place, size):
    """Occupied voxels in the cube around any place, also outside the grid."""
    half = size // 2
    low = [max(p - half, 0) for p in place]
    high = [max(p + half + 1, 0) for p in place]
    return int(np.count_nonzero(occupied[low[0] : high[0], low[1] : high[1], low[2] : high[2]]))


def moves(shift):
    """One sense of each of the 13 lattice directions, `shift` voxels along each of its axes."""
    found = []
    for direction in itertools.product((-1, 0, 1), repeat=3):
        if direction > (0, 0, 0):
            found.append(tuple(d * shift for d in direction))
    return found


def changes(occupied, size, shift):
    """Change of the count along each direction, whole per cent, at most 255: (x, y, z, 13)."""
    out = np.zeros((*occupied.shape, 13), np.int64)
    for place in itertools.product(*(range(n) for n in occupied.shape)):
        here = count_at(occupied, place, size)
        for number, move in enumerate(moves(shift)):
            there = [
                count_at(occupied, [p + sense * m for p, m in zip(place, move, strict=True)], size)
                for sense in (1, -1)
            ]
            if here:
                out[(*place, number)] = min(max(abs(t - here) for t in there) * 100 // here, 255)
    return out


def classes(occupied, size, shift, min_change):
    """0 not occupied, 1 flat, 2 edge, 3 corner."""
    out = np.zeros(occupied.shape, np.int64)
    change = changes(occupied, size, shift)
    for place in np.argwhere(occupied):
        steady = int(np.count_nonzero(change[tuple(place)] < min_change))
        out[tuple(place)] = 3 if steady == 0 else 2 if steady == 1 else 1
    return out
