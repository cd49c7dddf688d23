"""Tables and figures of the calibration's rows."""

import numpy as np
import pytest
from bench.reliability import calibration_error, error_of_exact, lower_bound, summary, upper_bound


def test_calibration_error_is_the_mean_gap_over_bins():
    confidence = np.asarray([0.95, 0.95, 0.15, 0.15])
    assert calibration_error(confidence, np.asarray([1.0, 1.0, 0.0, 0.0])) == pytest.approx(0.1)
    assert calibration_error(confidence, np.asarray([1.0, 0.0, 0.0, 0.0])) == pytest.approx((0.9 + 0.3) / 4)


def test_bound_of_a_rate_that_was_never_seen():
    assert upper_bound(0, 300) == pytest.approx(1.0 - 0.05 ** (1 / 300))
    assert upper_bound(5, 5) == 1.0
    assert lower_bound(300, 300) == pytest.approx(0.05 ** (1 / 300))
    assert lower_bound(0, 5) == 0.0


def test_exact_probabilities_of_few_pairs_show_an_error_and_those_of_many_a_small_one():
    assert error_of_exact(np.asarray([1.0, 0.0])) == 0.0
    assert error_of_exact(np.full(4, 0.5)) == pytest.approx(0.1875, abs=0.03)
    assert error_of_exact(np.full(2500, 0.5)) < 0.02


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
