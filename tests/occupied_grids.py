"""Small occupied grids, for the tests of kernels that work block by block."""

import numpy as np

SHAPES = [(1, 1, 1), (8, 8, 32), (9, 17, 33), (3, 40, 5), (16, 1, 70)]


def random_grid(shape, share=0.1, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def walls(shape=(40, 33, 70)):
    """A floor and a wall: most blocks are empty."""
    occupied = np.zeros(shape, bool)
    occupied[2:30, 3:30, 9] = occupied[7, 3:30, 9:40] = True
    return occupied


def blocks_of(occupied):
    """Occupied blocks from the definition."""
    return sorted({tuple(int(c) // 8 for c in voxel) for voxel in np.argwhere(occupied)})
