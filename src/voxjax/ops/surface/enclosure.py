"""How enclosed a voxel is: in how many of the 26 directions of the lattice something occupied lies within reach."""

from itertools import product

import numpy as np
from jaxtyping import Bool, UInt8

DIRECTIONS = np.asarray([d for d in product((-1, 0, 1), repeat=3) if d != (0, 0, 0)], np.int32)
"""The 26 directions, int32 (26, 3)."""


def enclosing_directions(occupied: Bool[np.ndarray, "x y z"], *, reach: float) -> UInt8[np.ndarray, "x y z"]:
    """Number of lattice directions along which a voxel meets something occupied.

    On the host: whole-array shifts of booleans, whose shapes differ from map to map, so that compiling would take
    longer than running. Ranges double: what is met within 2 k steps is met within k steps here or k steps farther on.

    Args:
        occupied: Voxels that stop a ray.
        reach: Length of the rays, from the voxel's centre [voxel]; the voxel itself does not count.

    Returns:
        uint8 in [0, 26].
    """
    count = np.zeros(occupied.shape, np.uint8)
    for direction in DIRECTIONS:
        # Rays have one length in all directions, so that diagonal ones have fewer steps.
        steps = int(reach / np.linalg.norm(direction))
        if steps < 1:
            continue
        # Only the first step looks at the voxels; a later one looks up what is known `more` steps on.
        met = np.zeros_like(occupied)
        _merge_shifted(met, occupied, direction)
        covered = 1
        while covered < steps:
            more = min(covered, steps - covered)
            _merge_shifted(met, met.copy(), more * direction)
            covered += more
        count += met
    return count


def _merge_shifted(target: np.ndarray, source: np.ndarray, move: np.ndarray) -> None:
    """`target[p] |= source[p + move]` wherever `p + move` lies in the block."""
    if (np.abs(move) >= source.shape).any():
        return
    here = tuple(slice(max(-m, 0), n - max(m, 0)) for m, n in zip(move, source.shape, strict=True))
    there = tuple(slice(max(m, 0), n + min(m, 0)) for m, n in zip(move, source.shape, strict=True))
    target[here] |= source[there]
