"""Walls, floors and ceilings of the small building."""

import dataclasses

import numpy as np

from small_worlds import FURNITURE
from voxjax.registration.judging.structure import lies_on_structure


def test_walls_and_floors_are_structure_and_furniture_is_not(pair):
    a = pair[0]
    points = np.asarray(a.prepared.points)[: a.prepared.num_points]
    is_structure = lies_on_structure(a)
    on_floor = points[:, 2] < -0.02
    assert is_structure[on_floor].mean() > 0.5
    low, high = np.asarray(FURNITURE[0])
    on_table = ((points > low - 0.05) & (points < high + 0.05)).all(axis=1) & (points[:, 2] > 0.3)
    assert on_table.sum() > 20
    assert is_structure[on_table].mean() < 0.3


def test_the_more_of_a_map_a_plane_must_hold_the_fewer_planes_there_are(pair):
    shares = [lies_on_structure(pair[0], share).mean() for share in (0.0, 0.01, 0.1, 1.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > shares[-1] == 0.0


def test_a_place_without_directions_has_no_structure(pair):
    forest = dataclasses.replace(pair[0], directions=np.zeros((0, 3)), shares=np.zeros(0))
    assert not lies_on_structure(forest).any()
