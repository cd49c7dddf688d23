"""Campuses."""

import numpy as np

from voxjax.synthetic.families import make_place


def test_buildings_reach_into_the_ground_and_ways_lead_between_them():
    place = make_place("campus", 3)
    assert place.ground is not None
    blocks = [part for part in place.fixed if part[3] == "wall" and part[2] - part[1] > 7.0]
    assert len(blocks) > 15
    for footprint, bottom, _, _ in blocks:
        # None floats above the ground at any of its corners, but bays, which begin higher up.
        if bottom < place.ground.at(footprint).mean() - 3.0:
            assert (bottom < place.ground.at(footprint)).all()
    solids = place.scene(np.random.default_rng(0)).solids
    assert (solids.distance(place.path).min(axis=1) > 0.5).mean() > 0.9
    height = place.path[:, 2] - place.ground.at(place.path[:, :2])
    np.testing.assert_allclose(height, height[0])


def test_cars_keep_off_the_ways_and_differ_from_day_to_day():
    place = make_place("campus", 4)
    days = [[part for piece in place.pieces for part in piece[day] if part[3] == "car"] for day in (0, 1)]
    for cars in days:
        assert len(cars) > 20
        middles = np.asarray([part[0].mean(axis=0) for part in cars])
        gaps = np.linalg.norm(middles[:, None] - place.path[None, :, :2], axis=2)
        assert gaps.min() > 2.4
    assert len(days[0]) != len(days[1]) or not np.allclose(days[0][0][0], days[1][0][0])
