"""The best similarity of two maps, and from when on its scale is another one."""

import numpy as np
import pytest

from hand_made_leaders import ACCEPTED, leaders
from voxjax.registration.causes.scale import (
    any_scale_finding,
    best_similarity,
    doubted_scale_finding,
    is_any_scale,
    is_other_scale,
    may_be_other_scale,
    scaled_finding,
)
from voxjax.registration.causes.settings import CauseConfig
from voxjax.registration.causes.similarity import Similarity, Start
from voxjax.registration.hypotheses.changed_features import scaled_features
from voxjax.registration.judging.settings import LeaderConfig

CAUSE = CauseConfig()
OPTIONS = {"settings": CAUSE, "leader": LeaderConfig(), "conflict_weight": 6.0}


def similarity(scale, log_error):
    return Similarity(scale, np.eye(4, dtype=np.float32), log_error, 0.3)


def test_the_best_of_many_starts_is_found_by_evidence(pair):
    a, b, truth = pair
    truth = truth.astype(np.float32)
    wrong = [np.array(truth) for _ in range(4)]
    for row, pose in enumerate(wrong):
        pose[row % 3, 3] += 3.0
    starts = [Start(1.0, pose) for pose in (*wrong[:2], truth, *wrong[2:])]
    best = best_similarity(a, scaled_features(b, 1.05), starts, **OPTIONS)
    assert best is not None
    found, score = best
    assert score > 0.6
    assert abs(found.scale * 1.05 - 1.0) < 0.015
    np.testing.assert_allclose(found.T_a_b, truth, atol=0.15)
    assert is_other_scale(found, CAUSE)


def test_a_map_as_it_should_be_has_no_other_scale(pair):
    a, b, truth = pair
    found = best_similarity(a, b, [Start(1.0, truth.astype(np.float32))], **OPTIONS)
    assert found is not None
    assert not is_other_scale(found[0], CAUSE)
    assert best_similarity(a, b, [], **OPTIONS) is None


@pytest.mark.parametrize(
    ("scale", "log_error", "expected"),
    [
        (1.02, 0.003, True),
        (0.98, 0.003, True),
        (1.02, 0.008, False),
        (1.008, 0.0001, False),
        (1.5, np.inf, False),
        (1.5, 0.001, False),
    ],
)
def test_a_scale_must_be_away_from_one_by_more_than_its_error_and_those_of_maps(scale, log_error, expected):
    assert is_other_scale(similarity(scale, log_error), CAUSE) == expected


@pytest.mark.parametrize(("scale", "words"), [(0.909, "larger by 10.0 %"), (1.25, "smaller by 20.0 %")])
def test_the_reason_says_by_how_much_map_b_is_too_large(scale, words):
    given, scaled = leaders(0.2, 0.04), leaders(0.62, 0.003)
    found = scaled_finding(ACCEPTED, given, scaled, ACCEPTED, similarity(scale, 0.003))
    assert found.verdict == "ambiguous"
    assert found.confidence == pytest.approx(1.0 - ACCEPTED.confidence)
    assert found.reason == (
        f"Map b seems to be {words}: with its lengths times {scale:.4f} it lies in map a with a strength of 0.60 and "
        "0.5 % of what meets in conflict, as it is with -0.04 and 16.7 %; bring both maps to metres (voxjax convert "
        "--scale, VoxelGrid.placed)."
    )


@pytest.mark.parametrize(
    ("scale", "log_error", "expected"),
    [
        (1.05, 0.02, True),
        (0.95, 0.02, True),
        (1.05, 0.03, False),
        (1.014, 0.006, False),
        (1.008, 0.001, False),
        (0.5, 0.01, False),
    ],
)
def test_a_scale_is_doubted_before_it_is_named(scale, log_error, expected):
    assert may_be_other_scale(similarity(scale, log_error), CAUSE) == expected
    assert not is_other_scale(similarity(scale, log_error), CAUSE)
    assert may_be_other_scale(similarity(1.02, 0.005), CAUSE)


@pytest.mark.parametrize(("scale", "words"), [(0.95, "larger by 5.3 %"), (1.06, "smaller by 5.7 %")])
def test_the_reason_of_a_doubt_gives_the_scale_with_its_error(scale, words):
    found = doubted_scale_finding(ACCEPTED, similarity(scale, 0.02))
    assert found.verdict == "ambiguous"
    assert found.confidence == 0.5
    assert found.reason == (
        f"Map b may be {words} (standard error 2.0 %), which explains the maps as well as the scale that it has: bring "
        "both maps to metres (voxjax convert --scale, VoxelGrid.placed), or give larger maps, which show the scale "
        "better."
    )


def test_alignment_that_shrinks_a_map_onto_a_corner_leaves_its_size_open():
    assert is_any_scale(similarity(0.18, 0.13), CAUSE)
    assert is_any_scale(similarity(3.0, 0.01), CAUSE)
    assert not is_any_scale(similarity(0.95, 0.02), CAUSE)
    found = any_scale_finding(ACCEPTED)
    assert (found.verdict, found.confidence) == ("ambiguous", 0.5)
    assert found.reason == (
        "What agrees would agree as well if map b had another size, as walls of a single corner would, and those of "
        "other places do; what would help are maps that share more of the place."
    )
