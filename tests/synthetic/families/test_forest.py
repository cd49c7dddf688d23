"""Forests."""

import numpy as np
from scipy.spatial import KDTree

from voxjax.synthetic.families import make_place


def test_trees_stand_on_the_ground_and_keep_off_the_trail_and_from_each_other():
    place = make_place("forest", 1)
    assert place.ground is not None
    trunks = [part for part in place.fixed if part[3] == "trunk"]
    at = np.asarray([part[0].mean(axis=0) for part in trunks])
    assert len(at) > 150
    np.testing.assert_allclose([part[1] for part in trunks], place.ground.at(at) - 1.0, atol=1e-6)
    assert KDTree(place.path[:, :2]).query(at)[0].min() > 1.29
    assert KDTree(at).query(at, k=2)[0][:, 1].min() > 1.29
    height = place.path[:, 2] - place.ground.at(place.path[:, :2])
    np.testing.assert_allclose(height, height[0])
