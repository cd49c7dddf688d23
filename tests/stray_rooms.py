"""A room with a stray voxel far away, for the tests of what readers leave out."""

import numpy as np

import voxjax as vx


def room(*, log_odds=False):
    """A closed room of 0.2 m voxels in a long box, with a stray voxel at its end and a row of free ones before it."""
    states = np.zeros((400, 12, 10), np.uint8)
    states[:14] = 2
    states[1:13, 1:11, 1:9] = 1
    states[14:399, 5, 5] = 1
    states[399, 5, 5] = 2
    odds = np.choose(states, [np.float32(0), np.float32(-2), np.float32(3)]) if log_odds else None
    return vx.VoxelGrid(states, [1.0, 2.0, 3.0], 0.2, odds)
