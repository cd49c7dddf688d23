"""Memory of maps in blocks, estimated from their leaves, against what painting them takes."""

import tracemalloc

import numpy as np
import pytest

from voxjax.io.block_need import count_blocks, cutting_bytes, most_bytes, painting_bytes
from voxjax.io.canvas import canvas_for
from voxjax.io.leaf_parts import cut_leaves
from voxjax.io.leaves import Leaves, leaf_map
from voxjax.io.paint import paint


def make_leaves(name, *, has_log_odds):
    rng = np.random.default_rng(0)
    depth, key = {
        "dense": (16, np.argwhere(np.ones((80, 80, 64)))),
        "tenth": (16, np.argwhere(rng.random((128, 128, 80)) < 0.1)),
        "surface": (16, np.argwhere(np.ones((640, 640, 1)))),
        "stray": (16, np.concatenate([np.argwhere(np.ones((640, 640, 1))), [[20000, 0, 0]]])),
        "wide": (14, 4 * np.argwhere(np.ones((40, 40, 40)))),
        "very wide": (9, 128 * np.argwhere(np.ones((6, 6, 6)))),
    }[name]
    value = rng.integers(1, 3, len(key)).astype(np.uint8)
    odds = np.where(value == 2, np.float32(0.85), np.float32(-0.4))
    level = Leaves(depth, key.astype(np.int32) + 12345, odds if has_log_odds else value)
    return leaf_map([level], 0.1, has_log_odds=has_log_odds)


@pytest.mark.parametrize("name", ["dense", "tenth", "surface", "stray", "wide", "very wide"])
def test_estimates_are_near_what_is_taken(name):
    for has_log_odds in (False, True):
        leaves = make_leaves(name, has_log_odds=has_log_odds)
        for voxel_size in (0.1, 0.25):
            tracemalloc.start()
            canvas = canvas_for(leaves, voxel_size)
            made = paint(cut_leaves(leaves, canvas), canvas)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            # Tables and blocks are memory of the operating system's, which NumPy does not count.
            taken = leaves.num_bytes + peak + sum(array.pool.nbytes for array in made if array is not None)
            if name != "stray":  # most pages of its tables are never written
                taken += (3 if has_log_odds else 2) * made[0].table.nbytes
            estimate = painting_bytes(leaves, voxel_size, canvas.shape)
            assert taken / 1.5 < estimate < 1.5 * taken
            assert cutting_bytes(leaves, voxel_size, canvas.shape) < 1.2 * estimate
            assert most_bytes(leaves, voxel_size, canvas.shape) > 0.8 * estimate


def test_blocks_are_counted_before_they_are_made():
    for name in ("tenth", "stray", "very wide"):
        leaves = make_leaves(name, has_log_odds=True)
        canvas = canvas_for(leaves, 0.1)
        cut = cut_leaves(leaves, canvas)
        states, _ = paint(cut, canvas)
        assert count_blocks(cut) == np.count_nonzero(~states.is_uniform)
