"""Stairwells."""

import numpy as np

from voxjax.synthetic.families import make_place
from voxjax.synthetic.prisms import make_prisms


def test_steps_rise_evenly_over_all_storeys():
    place = make_place("stairwell", 1)
    tops = np.unique(np.round([part[2] for part in place.fixed if part[3] == "step"], 6))
    rises = np.diff(tops)
    np.testing.assert_allclose(rises, rises[0], atol=1e-5)
    assert 0.15 < rises[0] < 0.18


def test_the_way_stays_a_man_s_height_above_the_steps():
    place = make_place("stairwell", 2)
    inside = make_prisms(place.fixed).distance(place.path).min(axis=1)
    assert inside.min() > 0.25
    # Storeys are equal: the way of each is that of the one below.
    rise = place.path[5] - place.path[0]
    np.testing.assert_allclose(rise[:2], 0.0)
    np.testing.assert_allclose(place.path[5:10] - place.path[:5], np.tile(rise, (5, 1)))
