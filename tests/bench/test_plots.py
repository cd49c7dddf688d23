"""Curves and intervals of the registration benchmark's plots."""

import numpy as np
import pytest
from bench.plots import error_curve, wilson_interval
from summary_rows import row


def test_error_curve_counts_pairs_without_a_pose():
    values, share = error_curve([row(metres=0.2), row(metres=0.1), row(metres=None)], "metres")
    np.testing.assert_allclose(values, [0.1, 0.2])
    np.testing.assert_allclose(share, [1 / 3, 2 / 3])


def test_wilson_interval_of_a_known_share():
    assert wilson_interval(9, 10) == pytest.approx((0.5958, 0.9821), abs=1e-3)
    assert wilson_interval(0, 0) == (0.0, 1.0)
