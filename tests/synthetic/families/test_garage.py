"""Parking garages."""

import numpy as np

from voxjax.synthetic.families import make_place


def test_floors_are_equal_but_for_their_cars():
    place = make_place("garage", 2)
    pillars = [part for part in place.fixed if part[3] == "wall" and np.ptp(part[0][:, 0]) < 0.5]
    bottoms = sorted({round(part[1], 6) for part in pillars})
    assert len(bottoms) == 3
    floors = [[part[0] for part in pillars if round(part[1], 6) == z] for z in bottoms]
    for floor in floors[1:]:
        np.testing.assert_allclose(floor, floors[0])
    cars = [part for usual, _ in place.pieces for part in usual]
    counts = [sum(z <= part[1] < z + 2.0 for part in cars) for z in bottoms]
    assert min(counts) > 5
    assert len(set(counts)) > 1


def test_the_way_climbs_to_the_highest_floor_above_slabs():
    place = make_place("garage", 3)
    slabs = [part for part in place.fixed if part[3] == "floor"]
    heights = []
    for at in place.path:
        below = [
            part[2]
            for part in slabs
            if (part[0].min(axis=0) <= at[:2]).all()
            and (at[:2] <= part[0].max(axis=0)).all()
            and part[2] < at[2]
        ]
        heights.append(at[2] - max(below))
    assert np.ptp(place.path[:, 2]) > 5.0
    assert 0.9 < min(heights) <= max(heights) < 2.4
