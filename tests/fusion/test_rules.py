"""Fusion rules: laws, and the definitions voxel by voxel."""

import itertools

import numpy as np
import pytest

from oracles import fusion as oracle
from voxjax.fusion.rules import fuse_keep, fuse_log_odds, fuse_paper, log_odds_of_states

# Every combination of the states of three maps, and of which maps reach the voxel.
STATES = np.array(list(itertools.product((0, 1, 2), repeat=3)), np.uint8).T
ALL = np.ones(STATES.shape, bool)
STATES_AND_COVER = list(itertools.product(STATES.T, itertools.product((False, True), repeat=3)))


def test_paper_says_occupied_if_any_free_if_all_otherwise_unknown():
    states = np.array([s for s, _ in STATES_AND_COVER]).T
    covered = np.array([c for _, c in STATES_AND_COVER]).T
    fused = np.asarray(fuse_paper(states, covered))
    assert fused.tolist() == [
        oracle.paper(s, c) for s, c in zip(states.T.tolist(), covered.T.tolist(), strict=True)
    ]


def test_paper_table_of_two_maps():
    states = np.array([[0, 0, 0, 1, 1, 1, 2, 2, 2], [0, 1, 2, 0, 1, 2, 0, 1, 2]], np.uint8)
    assert np.asarray(fuse_paper(states, np.ones((2, 9), bool))).tolist() == [0, 0, 2, 0, 1, 2, 2, 2, 2]


def test_keep_says_occupied_if_any_else_free_if_any():
    assert np.asarray(fuse_keep(STATES)).tolist() == [oracle.keep(s) for s in STATES.T.tolist()]


def test_log_odds_adds_the_evidence_of_those_who_know():
    rng = np.random.default_rng(0)
    values = rng.normal(0, 2, STATES.shape).astype(np.float32)
    states, total = fuse_log_odds(STATES, values)
    expected = [oracle.log_odds(s, v) for s, v in zip(STATES.T.tolist(), values.T.tolist(), strict=True)]
    np.testing.assert_array_equal(states, [state for state, _ in expected])
    np.testing.assert_allclose(total, [value for _, value in expected], atol=1e-6)


def rule(name):
    return {
        "paper": lambda s: np.asarray(fuse_paper(s, np.ones(s.shape, bool))),
        "keep": lambda s: np.asarray(fuse_keep(s)),
        "log_odds": lambda s: np.asarray(fuse_log_odds(s, log_odds_of_states(s))[0]),
    }[name]


@pytest.mark.parametrize("name", ["paper", "keep", "log_odds"])
def test_commutative(name):
    for order in itertools.permutations(range(3)):
        np.testing.assert_array_equal(rule(name)(STATES[list(order)]), rule(name)(STATES))


@pytest.mark.parametrize("name", ["paper", "keep", "log_odds"])
def test_a_map_fused_with_itself_has_the_same_states(name):
    np.testing.assert_array_equal(rule(name)(STATES[[0, 0]]), STATES[0])


@pytest.mark.parametrize("name", ["paper", "keep"])
def test_three_at_once_equal_one_after_another(name):
    two = rule(name)(STATES[:2])
    np.testing.assert_array_equal(rule(name)(np.stack([two, STATES[2]])), rule(name)(STATES))


def test_log_odds_of_a_map_fused_with_itself_grow_surer_up_to_the_limits():
    _, total = fuse_log_odds(
        np.array([[1, 2, 2], [1, 2, 2]], np.uint8), np.array([[-0.5, 0.5, 3], [-0.5, 0.5, 3]], np.float32)
    )
    np.testing.assert_allclose(total, [-1.0, 1.0, 3.511031], atol=1e-5)


def test_a_sum_of_nothing_but_doubt_is_occupied_as_in_octomap():
    states, total = fuse_log_odds(np.array([[1], [2]], np.uint8), np.array([[-0.5], [0.5]], np.float32))
    assert (int(states[0]), float(total[0])) == (2, 0.0)
