"""Lookup in blocks against the dense lookup: kinds of blocks, values, and which voxels lie in the box."""

import numpy as np
import pytest
from tests import dense_fusion
from tests.ops.blocks.boxes import random_boxes

from oracles.motions import random_pose
from voxjax import InputError
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.block_lookup import (
    EMPTY,
    INSIDE,
    LEVEL,
    MIXED,
    OUTSIDE,
    MovedBlocks,
    check_target,
    padded,
    runs,
)
from voxjax.ops.resampling.rigid import source_from_target

TARGET = (72, 64, 56)


def blocks_in_order(values):
    """A dense array as (n, 512), in C order of the blocks."""
    a, b, c = (n // 8 for n in values.shape)
    return values.reshape(a, 8, b, 8, c, 8).transpose(0, 2, 4, 1, 3, 5).reshape(a * b * c, 512)


def moved_map(seed, ratio=1.0):
    rng = np.random.default_rng(seed)
    states = random_boxes((45, 38, 29), seed=seed, num_boxes=8, share=1e-4)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    T = random_pose(rng, metres=1.0)
    affine = source_from_target(
        T, np.array([-2.0, -1.7, -1.4]) * ratio, 0.1 * ratio, np.array([-35, -31, -28]), 0.1
    )
    return (states, log_odds), MovedBlocks((blocks_of(states), blocks_of(log_odds)), affine)


@pytest.mark.parametrize("ratio", [1.0, 1.5, 4.0])
@pytest.mark.parametrize("seed", range(6))
def test_kinds_covers_and_values_are_those_of_the_dense_lookup(seed, ratio):
    arrays, source = moved_map(seed, ratio)
    (states, log_odds), is_inside = dense_fusion.lookup(arrays, source.affine, TARGET)
    states, log_odds, is_inside = (blocks_in_order(v) for v in (states, log_odds, is_inside))
    low, high = np.zeros(3, int), np.array(TARGET) // 8
    survey = source.survey(low, high)
    kind, cover = survey.kind.reshape(-1), survey.cover.reshape(-1)
    assert not states[kind == EMPTY].any()
    assert not log_odds[kind == EMPTY].any()
    assert not is_inside[cover == OUTSIDE].any()
    assert is_inside[cover == INSIDE].all()
    places = np.argwhere(np.ones(high, bool))
    middles = source.middles(places)
    level = kind == LEVEL
    assert ratio > 1.0 or level.sum() + (kind == EMPTY).sum() > 20
    for values, found in zip((states, log_odds), middles, strict=True):
        np.testing.assert_array_equal(values[level], np.repeat(found[level, None], 512, axis=1))
    # All blocks can be looked up, whatever their kind.
    look_up = source.look_up(places)
    for part, length in runs(len(places)):
        count = part.stop - part.start
        for values, found in zip((states, log_odds), look_up(part, length), strict=True):
            np.testing.assert_array_equal(np.asarray(found)[:count], values[part])
        np.testing.assert_array_equal(
            np.asarray(source.covered(places[part], length))[:count], is_inside[part]
        )
    assert (kind == MIXED).any()


def test_windows_far_from_the_map_hold_nothing():
    _, source = moved_map(0)
    assert source.holds_any(np.zeros(3, int), np.array(TARGET) // 8)
    for step in ([100, 0, 0], [-100, 0, 0], [0, 0, 3000]):
        low = np.array(step)
        assert not source.holds_any(low, low + 4)
        survey = source.survey(low, low + 4)
        assert (survey.kind == EMPTY).all()
        assert (survey.cover == OUTSIDE).all()


def test_runs_have_few_lengths_and_are_padded_with_their_last_row():
    assert [(part.start, part.stop, length) for part, length in runs(2100)] == [
        (0, 1024, 1024),
        (1024, 2048, 1024),
        (2048, 2100, 64),
    ]
    assert list(runs(0)) == []
    np.testing.assert_array_equal(padded(np.arange(3), 5), [0, 1, 2, 2, 2])


def test_targets_that_float32_or_int32_do_not_hold_are_refused():
    check_target((1 << 22, 8, 8), "the map", "do less")
    for shape in (((1 << 22) + 1, 1, 1), (1 << 17, 1 << 17, 1 << 17)):
        with pytest.raises(
            InputError, match=r"the map must have at most 4,194,304 voxels .*, got .* voxels; do less\."
        ):
            check_target(shape, "the map", "do less")
