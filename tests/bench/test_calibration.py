"""Rows of the calibration, their tables, and the fit of the verdict's model."""

import dataclasses

import numpy as np
import pytest
from bench.calibration import judge
from bench.calibration_worlds import KINDS, seeds_of, without_free_space
from bench.reliability import calibration_error, summary, upper_bound
from bench.verdict_fit import chances, fit, judgement_of

from small_worlds import draw_map, pose
from voxjax import register
from voxjax.registration.judging import conflict_pieces, verdict


def leader(score, support=0.2, contradiction=0.0, *, right=False):
    return {
        "score": score,
        "support": support,
        "contradiction": contradiction,
        "shared": 1000.0,
        "conflict": 0.0,
        "right": right,
    }


@pytest.mark.parametrize("has_free_space", [True, False])
def test_with_the_coefficients_in_use_the_fit_has_the_probabilities_of_the_verdict(has_free_space):
    row = {"leaders": [leader(0.6, 0.3, 2.0), leader(0.5, 0.1, 0.5), leader(0.1, 0.01), leader(-0.2)]}
    judged, _ = judgement_of(row)
    used = verdict.WITH_FREE_SPACE if has_free_space else verdict.WITHOUT_FREE_SPACE
    first = np.asarray([used.none, used.score, used.support])
    ours = chances(judged, first=first, piece=conflict_pieces.RIVAL_WEIGHT, has_free_space=has_free_space)
    np.testing.assert_allclose(
        ours, verdict.probabilities(judged, has_free_space=has_free_space), rtol=1e-9, atol=1e-15
    )


def test_the_fit_finds_that_pieces_and_not_scores_decide_between_rivals():
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(40):
        clean, dirty = rng.uniform(0.6, 0.8), rng.uniform(0.7, 0.9)
        both = [leader(dirty, contradiction=rng.uniform(8, 20)), leader(clean, right=True)]
        rows.append({"leaders": both, "rank": 1})
        rows.append({"leaders": [leader(rng.uniform(0.01, 0.05), 0.01)], "rank": None})
    first, piece = fit(rows, has_free_space=True)
    assert piece > 1.0
    assert chances(judgement_of(rows[0])[0], first=first, piece=piece, has_free_space=True)[2] > 0.9
    assert chances(judgement_of(rows[1])[0], first=first, piece=piece, has_free_space=True)[0] > 0.9


@pytest.mark.slow
def test_a_row_tells_what_was_said_and_what_is_true():
    T = pose(yaw=20.0, translation=(1.0, 2.0, 0.0))
    a, b = draw_map(), draw_map(T)
    found = register(a, b)
    row = judge(found, np.linalg.inv(T), b)
    assert row["right"]
    assert row["rank"] == 0
    assert row["verdict"] == found.verdict
    assert row["leaders"][0]["right"]
    assert row["leaders"][0]["support"] > 0.0
    assert len(row["tangent"]) == 6
    assert row["metres"] < 0.1
    other = judge(found, None, b)
    assert not other["right"]
    assert other["rank"] is None


def test_free_space_is_taken_away_and_nothing_else():
    grid = draw_map()
    cloud = without_free_space(grid)
    assert cloud.num_free == 0
    assert cloud.num_occupied == grid.num_occupied


def test_kinds_share_no_seed():
    taken = [set(seeds_of(kind, 20, 1000)) for kind in KINDS]
    assert all(len(seeds) == 20 for seeds in taken)
    assert not taken[0] & taken[1]
    assert not (taken[0] | taken[1]) & taken[2]


def test_calibration_error_is_the_mean_gap_over_bins():
    confidence = np.asarray([0.95, 0.95, 0.15, 0.15])
    assert calibration_error(confidence, np.asarray([1.0, 1.0, 0.0, 0.0])) == pytest.approx(0.1)
    assert calibration_error(confidence, np.asarray([1.0, 0.0, 0.0, 0.0])) == pytest.approx((0.9 + 0.3) / 4)


def test_bound_of_a_rate_that_was_never_seen():
    assert upper_bound(0, 300) == pytest.approx(1.0 - 0.05 ** (1 / 300))
    assert upper_bound(5, 5) == 1.0


def test_the_table_counts_right_and_wrong_accepts_by_kind():
    plain = {
        "confidence": 0.95,
        "rank": 0,
        "right": True,
        "kind": "pair",
        "degrees": 0.1,
        "metres": 0.02,
        "tangent": [0.0] * 6,
        "covariance": np.eye(6).tolist(),
        "verdict": "accepted",
    }
    wrong = plain | {"right": False, "rank": None, "kind": "hotel"}
    text = "\n".join(summary([plain, plain, wrong]))
    assert "| one building (2) | 2 | 2 | 2 | 0 " in text
    assert "| equal rooms (1) | 0 | 0 | 0 | 1 " in text


def test_evidence_of_a_registration_holds_what_the_fit_needs():
    names = {
        field.name for field in dataclasses.fields(register(draw_map(), draw_map()).hypotheses[0].evidence)
    }
    assert {"support", "shared_area", "contradiction_area"} <= names
