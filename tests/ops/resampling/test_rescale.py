"""Change of resolution: laws and the voxel-by-voxel definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import resampling as oracle
from voxjax import InputError
from voxjax.ops.resampling.rescale import rescale_states

ORIGIN = np.array([-0.4, 0.8, 1.2], np.float32)


def make_states(seed=0, shape=(7, 6, 5)) -> np.ndarray:
    return np.random.default_rng(seed).choice(np.arange(3, dtype=np.uint8), shape, p=[0.5, 0.4, 0.1])


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.15, 0.2, 0.3, 0.14, 0.5]))
@settings(max_examples=30, deadline=None)
def test_coarser_voxels_are_occupied_if_any_part_is_else_free_if_any_is(seed, new_size):
    states = make_states(seed)
    low = np.random.default_rng(seed).integers(-30, 30, 3)
    coarse, origin, _ = rescale_states(states, (low * 0.1).astype(np.float32), 0.1, new_size)
    first = np.rint(origin / new_size).astype(int)
    np.testing.assert_allclose(first * new_size, origin, atol=1e-5)
    expected = oracle.coarser(states, low, 0.1 / new_size)
    assert {tuple((np.array(i) + first).tolist()): int(s) for i, s in np.ndenumerate(coarse)} == expected


@pytest.mark.parametrize("factor", [2, 3])
def test_finer_voxels_are_the_voxels_split(factor):
    states = make_states()
    fine, origin, _ = rescale_states(states, ORIGIN, 0.2, 0.2 / factor)
    expected = states
    for axis in range(3):
        expected = expected.repeat(factor, axis)
    np.testing.assert_array_equal(fine, expected)
    np.testing.assert_allclose(origin, ORIGIN, atol=1e-6)


@pytest.mark.parametrize("factor", [2, 3, 4])
def test_splitting_and_joining_is_the_identity(factor):
    states = make_states()
    odds = np.where(states == 0, 0, np.random.default_rng(1).normal(size=states.shape)).astype(np.float32)
    fine = rescale_states(states, ORIGIN, 0.2, 0.2 / factor, odds)
    back = rescale_states(fine[0], fine[1], 0.2 / factor, 0.2, fine[2])
    np.testing.assert_array_equal(back[0], states)
    np.testing.assert_allclose(back[1], ORIGIN, atol=1e-7)
    np.testing.assert_array_equal(back[2], odds)


def test_log_odds_are_the_highest_of_the_known_parts():
    states = np.array([1, 0, 1, 1, 0, 0, 2, 1], np.uint8).reshape(8, 1, 1)
    odds = np.array([-2, 0, -1, -0.5, 0, 0, 3, -1], np.float32).reshape(8, 1, 1)
    coarse, _, log_odds = rescale_states(states, np.zeros(3, np.float32), 0.1, 0.2, odds)
    np.testing.assert_array_equal(coarse[:, 0, 0], [1, 1, 0, 2])
    np.testing.assert_array_equal(np.asarray(log_odds)[:, 0, 0], [-2, -0.5, 0, 3])


def test_a_grid_off_the_lattice_comes_onto_it():
    states = make_states()
    fine, origin, _ = rescale_states(states, ORIGIN + np.float32(0.03), 0.2, 0.1)
    np.testing.assert_allclose(origin / 0.1, np.rint(origin / 0.1), atol=1e-4)
    assert abs(int((fine == 2).sum()) - 8 * int((states == 2).sum())) <= 8 * int((states == 2).sum()) * 0.5


def test_a_grid_without_voxels_stays_one():
    assert rescale_states(np.zeros((0, 3, 3), np.uint8), ORIGIN, 0.1, 0.2)[0].shape == (0, 3, 3)


def test_too_fine_a_voxel_size_is_refused():
    with pytest.raises(InputError, match="larger voxel size"):
        rescale_states(make_states(), ORIGIN, 0.2, 0.0001)
