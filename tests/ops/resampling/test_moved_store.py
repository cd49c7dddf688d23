"""Windows of maps in stores are those of maps in blocks."""

import itertools

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes
from tests.ops.resampling.test_stored import stored_arrays

from oracles.motions import random_pose
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.block_lookup import EMPTY, OUTSIDE, MovedBlocks, runs
from voxjax.ops.resampling.moved_store import MovedStore
from voxjax.ops.resampling.rigid import source_from_target


@pytest.mark.parametrize("seed", range(6))
def test_windows_give_kinds_covers_and_values_of_the_whole_map(seed):
    rng = np.random.default_rng(seed)
    states = random_boxes((90, 70, 50), seed=seed, num_boxes=30, share=1e-4)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    T = random_pose(rng, metres=0.5, degrees=40)
    affine = source_from_target(T, np.array([-4.0, -3.7, -2.4]), 0.1, np.array([-70, -61, -58]), 0.1)
    whole = MovedBlocks((blocks_of(states), blocks_of(log_odds)), affine)
    store = MovedStore(stored_arrays(states, log_odds), affine)
    assert store.num_arrays == whole.num_arrays == 2
    seen = 0
    for corner in itertools.product((-7, 1, 9, 17), repeat=3):
        low, high = np.array(corner), np.array(corner) + 8
        expected = whole.survey(low, high)
        part = store.near(low, high)
        if part is None:
            assert (expected.cover == OUTSIDE).all()
            assert (expected.kind == EMPTY).all()
            continue
        assert store.holds_any(low, high) or (expected.kind == EMPTY).all()
        found = part.survey(low, high)
        np.testing.assert_array_equal(found.kind, expected.kind)
        np.testing.assert_array_equal(found.cover, expected.cover)
        places = low + np.argwhere(found.kind != EMPTY)
        for values, others in zip(part.middles(places), whole.middles(places), strict=True):
            np.testing.assert_array_equal(values, others)
        look_up, look_up_whole = part.look_up(places), whole.look_up(places)
        for run in runs(len(places)):
            for values, others in zip(look_up(*run), look_up_whole(*run), strict=True):
                np.testing.assert_array_equal(values, others)
            covered = part.covered(places[run[0]], run[1])
            np.testing.assert_array_equal(covered, whole.covered(places[run[0]], run[1]))
        seen += len(places)
    # The windows make up all of the target, and none of it is left out.
    assert seen == np.count_nonzero(whole.survey(np.full(3, -30), np.full(3, 50)).kind)
    assert seen > 500
