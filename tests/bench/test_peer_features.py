"""Matches of features for peers."""

import numpy as np
from bench.peer_features import mutual_matches


def test_mutual_matches_are_the_nearest_ones_in_order():
    features_b = np.array([[0.0], [10.0], [20.0], [20.6]])
    features_a = np.array([[20.5], [12.0], [0.3], [90.0]])
    np.testing.assert_array_equal(mutual_matches(features_b, features_a, most=9), [[3, 0], [0, 2], [1, 1]])
    np.testing.assert_array_equal(mutual_matches(features_b, features_a, most=2), [[3, 0], [0, 2]])
    assert mutual_matches(np.empty((0, 1)), features_a, most=2).shape == (0, 2)
