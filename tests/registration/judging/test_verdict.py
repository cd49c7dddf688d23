"""The verdict on judgements written by hand."""

import numpy as np
import pytest

from voxjax.registration.judging.conflict_pieces import net_scores, rivals
from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.settings import VerdictConfig
from voxjax.registration.judging.verdict import decide, probabilities, support

BOUNDS = VerdictConfig()


def judgement(*poses):
    """Each pose: hits, conflicts, least eigenvalue of the agreement, pieces [m^2]; all share 1000 m^2."""
    hits, conflicts, weakest, pieces = np.asarray(poses, np.float64).reshape(-1, 4).T
    information = (
        np.stack([np.diag([w, 0.3, 0.4]) / 3 for w in weakest]) if len(poses) else np.zeros((0, 3, 3))
    )
    return Judgement(hits, conflicts, np.zeros(len(hits)), information, pieces, np.full(len(hits), 1000.0))


GOOD, WEAK = (0.6, 0.003, 0.2, 0.5), (0.04, 0.0, 0.001, 0.0)


@pytest.mark.parametrize(
    ("poses", "has_free_space", "expected"),
    [
        ([GOOD, WEAK], True, "accepted"),
        ([GOOD], True, "accepted"),
        ([WEAK, WEAK], True, "no_overlap"),
        ([], True, "no_overlap"),
        ([(0.2, 0.1, 0.2, 0.0)], True, "no_overlap"),
        ([GOOD, (0.59, 0.003, 0.2, 0.5)], True, "ambiguous"),
        ([GOOD, (0.59, 0.003, 0.2, 10.0)], True, "accepted"),
        ([(0.5, 0.003, 0.2, 0.5), (0.59, 0.003, 0.2, 15.0)], True, "accepted"),
        ([(0.9, 0.003, 0.001, 0.0), WEAK], True, "ambiguous"),
        ([(0.95, 0.0, 0.7, 0.0), (0.4, 0.0, 0.1, 0.0)], False, "accepted"),
        ([(0.5, 0.0, 0.17, 0.0), (0.45, 0.0, 0.18, 0.0)], False, "no_overlap"),
    ],
)
def test_verdict_and_confidence_go_together(poses, has_free_space, expected):
    finding = decide(judgement(*poses), BOUNDS, has_free_space=has_free_space)
    assert finding.verdict == expected
    assert 0.0 <= finding.confidence <= 1.0
    assert (finding.confidence >= BOUNDS.min_confidence) == (expected == "accepted")
    assert finding.reason


def test_probabilities_are_a_choice_among_the_leaders_and_none():
    chance = probabilities(judgement(GOOD, (0.5, 0.003, 0.2, 0.5), WEAK), has_free_space=True)
    assert chance.shape == (4,)
    np.testing.assert_allclose(chance.sum(), 1.0)
    assert chance[1] > chance[2] > chance[3]
    alone = probabilities(judgement(GOOD), has_free_space=True)
    assert alone[1] > chance[1]


def test_beside_rivals_the_best_must_be_clean_itself():
    unclean = judgement((0.6, 0.003, 0.2, 4.0), (0.55, 0.003, 0.2, 50.0))
    finding = decide(unclean, BOUNDS, has_free_space=True)
    assert finding.verdict == "ambiguous"
    assert finding.confidence > 0.9
    assert "pieces" in finding.reason
    alone = judgement((0.6, 0.003, 0.2, 4.0), WEAK)
    assert decide(alone, BOUNDS, has_free_space=True).verdict == "accepted"


def test_rivals_stand_as_one_against_no_overlap():
    one = probabilities(judgement(GOOD), has_free_space=True)
    many = probabilities(judgement(*[GOOD] * 6), has_free_space=True)
    np.testing.assert_allclose(one[0], many[0], rtol=1e-9)
    np.testing.assert_allclose(many[1:], one[1] / 6)


def test_only_pieces_beyond_those_of_the_cleanest_rival_count():
    both = judgement((0.6, 0.0, 0.2, 2.0), (0.5, 0.0, 0.2, 2.0), (0.1, 0.0, 0.2, 0.0))
    np.testing.assert_array_equal(rivals(both), [True, True, False])
    np.testing.assert_allclose(net_scores(both), both.score())
    one = judgement((0.6, 0.0, 0.2, 3.0), (0.5, 0.0, 0.2, 0.0))
    np.testing.assert_allclose(net_scores(one), [0.15, 0.5])


def test_support_is_the_agreement_along_the_worst_direction():
    information = np.stack(
        [np.eye(3) / 3, np.diag([0.4, 0.3, 0.4]) / 3 * [1, 1 / 3, 1], np.diag([1.0, 1.0, 0.0])]
    )
    full = Judgement(np.ones(3), np.zeros(3), np.zeros(3), information, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(support(full), [1.0, 0.1, 0.0], atol=1e-12)
