"""The fit of the verdict's model."""

import numpy as np
import pytest
from bench.verdict_fit import chances, fit, judgement_of

from voxjax.registration.judging import verdict
from voxjax.registration.judging.settings import VerdictConfig


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
    ours = chances(judged, first=first, piece=VerdictConfig.rival_weight, has_free_space=has_free_space)
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
