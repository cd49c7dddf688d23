"""Lists of corners: padding is cut off, and the count may tell of more than are listed."""

import dataclasses

import numpy as np

from corner_lists import corners_at


def test_trimmed_lists_hold_the_corners_alone():
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    mask = np.asarray([True, False, True, False])
    corners = corners_at(points, mask=mask)
    assert corners.num_listed == 2
    trimmed = corners.trimmed()
    np.testing.assert_array_equal(trimmed.position, points[mask])
    assert trimmed.num_listed == len(trimmed.normals) == 2
    assert trimmed.covariance is None
    assert int(trimmed.num_found) == 4


def test_covariances_are_cut_with_their_corners():
    corners = corners_at(np.zeros((3, 3)), mask=np.asarray([False, True, True]))
    covariance = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    trimmed = dataclasses.replace(corners, covariance=covariance).trimmed()
    np.testing.assert_array_equal(trimmed.covariance, covariance[1:])
