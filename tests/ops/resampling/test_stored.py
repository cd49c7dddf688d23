"""What is read of a map in a store is what its blocks hold."""

import numpy as np
from tests.ops.blocks.boxes import random_boxes

from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.stored import Stored


def stored_arrays(*arrays, side=16):
    """Dense arrays as such a map, with cubes that hold something told from others."""
    lattice = tuple(-(-n // side) for n in arrays[0].shape)
    cubes = np.zeros(lattice, bool)
    cubes[tuple((np.argwhere(arrays[0]) // side).T)] = True

    def read(low, high):
        return tuple(v[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] for v in arrays)

    return Stored(arrays[0].shape, cubes, side, read, len(arrays))


def test_parts_are_those_of_the_blocks_in_their_order():
    states = random_boxes((37, 25, 18), seed=2)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    stored = stored_arrays(states, log_odds)
    for number, values in enumerate((states, log_odds)):
        found, expected = list(stored.parts(number)), list(blocks_of(values).parts())
        for k in range(2):
            of_store, of_blocks = (np.concatenate([part[k] for part in each]) for each in (found, expected))
            np.testing.assert_array_equal(of_store, of_blocks)
