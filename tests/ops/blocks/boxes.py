"""Arrays of states as maps have them: boxes of one value, and single voxels."""

import numpy as np


def random_boxes(shape, *, seed, num_boxes=6, share=0.001):
    """States (x, y, z): overlapping boxes of 0, 1 and 2, and a share of single voxels of 2."""
    rng = np.random.default_rng(seed)
    states = np.zeros(shape, np.uint8)
    for _ in range(num_boxes):
        corners = np.sort([[rng.integers(0, n + 1) for n in shape] for _ in range(2)], axis=0)
        states[tuple(slice(a, b) for a, b in corners.T)] = rng.integers(0, 3)
    states[rng.random(shape) < share] = 2
    return states
