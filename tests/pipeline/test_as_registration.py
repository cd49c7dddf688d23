"""Registrations put together from what the stages found."""

import numpy as np

import voxjax as vx
from voxjax.pipeline.as_registration import evidence_of, nothing_found
from voxjax.registration.judging.judgement import Judgement


def test_nothing_found_says_why_and_counts_nothing():
    found = nothing_found("Map a is empty.", vx.RESULTS.empty_map)
    assert found.verdict == "no_overlap"
    assert found.reason == "Map a is empty."
    assert found.hypotheses == ()
    assert found.stats["num_corners_a"] == found.stats["num_hypotheses"] == 0
    assert np.isinf(np.asarray(found.covariance)).all()


def test_what_was_counted_before_is_kept_and_corners_nobody_looked_for_are_not_counted():
    found = nothing_found(
        "No pose.", vx.RESULTS.too_few_corners, {"num_hypotheses": 7, "seconds": {"features": 1.0}}
    )
    assert found.stats["num_hypotheses"] == 7
    assert found.stats["seconds"] == {"features": 1.0}
    assert "num_corners_a" not in found.stats


def test_evidence_is_given_in_shares_of_what_met_anything_and_in_voxels():
    one = np.ones(1)
    judgement = Judgement(
        0.6 * one, 0.1 * one, 0.1 * one, np.eye(3)[None] / 3, 0.1 * one, one, 2.0 * one, 50.0 * one, one, one
    )
    found = evidence_of(judgement, 0, num_voxels=1000)
    np.testing.assert_allclose([found.occupied_agreement, found.free_conflict], [0.75, 0.125])
    assert (found.num_hits, found.num_conflicts) == (600, 100)
    np.testing.assert_allclose([found.score, found.support], [0.0, 1.0], atol=1e-12)
    assert (found.shared_area, found.contradiction_area) == (50.0, 2.0)
