"""When a pose is questioned, and from when on another map b is believed; on judgements written by hand."""

import numpy as np
import pytest

from hand_made_leaders import ACCEPTED, NOTHING, leaders
from voxjax.registration.causes.handedness import (
    best_score,
    conflict_share,
    has_far_fewer_conflicts,
    is_better,
    is_questionable,
    mirrored_finding,
)
from voxjax.registration.causes.settings import CauseConfig
from voxjax.registration.judging.judgement import no_judgement
from voxjax.registration.judging.leaders import Leaders, Tried

CAUSE = CauseConfig()
UNSURE = ACCEPTED._replace(verdict="ambiguous", confidence=0.7)
NOWHERE = np.zeros((0, 4, 4))
NONE = Leaders(NOWHERE, no_judgement(6.0, has_free_space=True), (), Tried(NOWHERE, np.zeros(0)))


@pytest.mark.parametrize(
    ("given", "finding", "expected"),
    [
        (leaders(0.6, 0.003), ACCEPTED, False),
        (leaders(0.6, 0.03), ACCEPTED, True),
        (leaders(0.6, 0.0, has_free_space=False), ACCEPTED, True),
        (leaders(0.6, 0.003), NOTHING, True),
        (NONE, NOTHING, True),
    ],
)
def test_contradictions_and_refusals_are_questioned(given, finding, expected):
    assert is_questionable(given, finding, CAUSE) == expected


def test_shares_and_scores_of_nothing():
    assert conflict_share(NONE.judgement) == 0.0
    assert best_score(NONE) < 0.0
    assert conflict_share(leaders(0.6, 0.2).judgement) == pytest.approx(0.25)
    assert best_score(leaders(0.6, 0.01)) == pytest.approx(0.54)


@pytest.mark.parametrize(
    ("finding", "given", "changed", "found", "expected"),
    [
        (ACCEPTED, leaders(0.6, 0.04), leaders(0.6, 0.003), ACCEPTED, True),
        (ACCEPTED, leaders(0.6, 0.003), leaders(0.6, 0.003), ACCEPTED, False),
        (ACCEPTED, leaders(0.6, 0.003), leaders(0.62, 0.003), ACCEPTED, False),
        (ACCEPTED, leaders(0.6, 0.04), leaders(0.6, 0.003), UNSURE, False),
        (NOTHING, leaders(0.1, 0.02), leaders(0.6, 0.003), UNSURE, True),
        # Which pose of the changed map is right may be open where it is twice as strong.
        (NOTHING, leaders(0.1, 0.02), leaders(0.6, 0.003), UNSURE._replace(confidence=0.3), True),
        (NOTHING, leaders(0.35, 0.003), leaders(0.6, 0.003), UNSURE._replace(confidence=0.3), False),
        (NOTHING, leaders(0.35, 0.003), leaders(0.6, 0.003), UNSURE, True),
        (NOTHING, leaders(0.1, 0.02), leaders(0.6, 0.003), UNSURE._replace(none=0.6), False),
        (NOTHING, leaders(0.1, 0.1), leaders(0.6, 0.003), NOTHING, False),
        (NOTHING, leaders(0.1, 0.1), leaders(0.1, 0.001), ACCEPTED, True),
        (NOTHING, NONE, leaders(0.6, 0.003), ACCEPTED, True),
    ],
)
def test_a_changed_map_must_be_believed_and_score_clearly_more(finding, given, changed, found, expected):
    assert is_better(finding, given, changed, found, CAUSE, is_clear=False) == expected


def test_a_small_gain_is_enough_where_far_fewer_conflicts_tell_them_apart():
    given = leaders(0.6, 0.01)
    for changed, is_clear, is_enough in (
        (leaders(0.6, 0.007), False, False),
        (leaders(0.58, 0.003), True, True),
        (leaders(0.55, 0.001), True, False),
    ):
        assert has_far_fewer_conflicts(given, changed) == is_clear
        assert is_better(ACCEPTED, given, changed, ACCEPTED, CAUSE, is_clear=is_clear) == is_enough


def test_the_reason_of_a_mirrored_map_has_the_figures_that_decided():
    found = mirrored_finding(ACCEPTED, leaders(0.6, 0.04), leaders(0.62, 0.003), ACCEPTED)
    assert found.verdict == "ambiguous"
    # At most one of both poses is right.
    assert found.confidence == pytest.approx(1.0 - ACCEPTED.confidence)
    assert found.none == ACCEPTED.none
    assert found.reason == (
        "Map b seems to be mirrored: its mirror image lies in map a with a strength of 0.60 and 0.5 % of what meets in "
        "conflict, as it is with 0.36 and 6.2 %; flip one axis of one of the maps."
    )


def test_the_reason_of_a_mirrored_cloud_has_the_strengths_and_no_scores():
    given, image = (leaders(hits, 0.0, has_free_space=False) for hits in (0.6, 0.55))
    # More of the map as it is comes near something, but hardly any of it lies on planes.
    given = given._replace(judgement=given.judgement._replace(exact=np.full(1, 0.05)))
    assert is_better(NOTHING, given, image, ACCEPTED, CAUSE, is_clear=False)
    reason = mirrored_finding(NOTHING, given, image, ACCEPTED).reason
    assert "a strength of 0.30 " in reason
    assert "as it is with 0.03 " in reason
