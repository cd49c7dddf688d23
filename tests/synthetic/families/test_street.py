"""Streets."""

import numpy as np

from voxjax.synthetic.families import make_place


def test_houses_stand_on_both_sides_and_cars_at_the_kerb():
    place = make_place("street", 5)
    walls = np.asarray([part[0].mean(axis=0) for part in place.fixed if part[3] == "wall"])
    road = min(np.ptp(part[0][:, 1]) for part in place.fixed if part[3] == "floor")
    assert (walls[:, 1] > 0.5 * road).sum() > 20
    assert (walls[:, 1] < -0.5 * road).sum() > 20
    cars = np.asarray([part[0].mean(axis=0) for usual, _ in place.pieces for part in usual])
    assert len(cars) > 10
    assert (np.abs(cars[:, 1]) < 0.5 * road).all()
    # The middle of the road is free.
    assert (np.abs(cars[:, 1]) > 1.2).all()
