"""A small furnished room as voxel states, for tests; imports nothing of the library."""

import numpy as np

VOXEL = 0.1


def furnished_room():
    """States of a room of 5 x 4 x 2.6 m with boxes of unequal size: walls occupied, air free, outside unknown."""
    states = np.zeros((54, 44, 30), np.uint8)
    states[1:53, 1:43, 1:29] = 2
    states[2:52, 2:42, 2:28] = 1
    boxes = (
        ((2, 2, 2), (12, 9, 10)),
        ((30, 2, 2), (45, 12, 16)),
        ((2, 28, 2), (16, 42, 7)),
        ((38, 30, 2), (52, 42, 20)),
        ((22, 18, 2), (31, 24, 9)),
    )
    for low, high in boxes:
        part = tuple(slice(i, j) for i, j in zip(low, high, strict=True))
        inner = tuple(slice(i + 1, j - 1) for i, j in zip(low, high, strict=True))
        states[part] = 2
        states[inner] = 0
    return states
