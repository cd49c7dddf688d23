"""Leaves painted one by one into a dense array of the whole box, which is then brought to another voxel size."""

import numpy as np

from voxjax.io.leaves import NUM_KEYS
from voxjax.ops.resampling.rescale import rescale_states


def painted(leaves, voxel_size):
    """States and log-odds (or None) of a map of leaves."""
    states = np.zeros(leaves.shape, np.uint8)
    log_odds = np.zeros(leaves.shape, np.float32) if leaves.has_log_odds else None
    for level in leaves.levels:
        low, high = leaves.boxes(level)
        for begin, end, state, value in zip(low, high, level.states(), level.value, strict=True):
            box = tuple(slice(a, b) for a, b in zip(begin - leaves.low, end - leaves.low, strict=True))
            states[box] = state
            if log_odds is not None:
                log_odds[box] = value
    if voxel_size == leaves.resolution:
        return states, log_odds
    origin = (leaves.low - NUM_KEYS // 2) * leaves.resolution
    states, _, log_odds = rescale_states(states, origin, leaves.resolution, voxel_size, log_odds)
    return states, log_odds
