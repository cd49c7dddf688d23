"""Things in one map that stand in free space of the other, on the small building."""

import dataclasses

import numpy as np
import pytest

from small_worlds import FURNITURE, draw_map, pose
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.judging.contradictions import find_contradictions
from voxjax.registration.judging.settings import VerdictConfig

IDENTITY = np.eye(4)
CUPBOARD, MOVED = FURNITURE[1], ((2.6, 0.5, 0.0), (3.6, 1.3, 1.9))
BOUNDS = VerdictConfig()


def features(T=None, furniture=FURNITURE):
    return map_features(draw_map(T, furniture=furniture), max_virtual=8)


@pytest.fixture(scope="module")
def moved():
    """The building after somebody moved the cupboard."""
    return features(furniture=(FURNITURE[0], MOVED, *FURNITURE[2:]))


def test_the_same_building_in_two_frames_has_none(pair):
    a, b, truth = pair
    found = find_contradictions(a, b, truth)
    assert found.share == 0.0
    assert found.pieces == ()
    assert found.area == 0.0
    prepared = a.prepared
    assert found.agreeing > 1.8 * prepared.num_points * prepared.grid.voxel_size**2


def test_a_moved_cupboard_is_named_in_both_places(pair, moved):
    found = find_contradictions(pair[0], moved, IDENTITY)
    assert found.share > BOUNDS.max_changes
    largest = {name: next(p for p in found.pieces if p.occupied_in == name) for name in "ab"}
    for name, (low, high) in (("a", CUPBOARD), ("b", MOVED)):
        # The box lies around the cupboard, but for the sides that stand at walls, and for a voxel or two.
        np.testing.assert_allclose(largest[name].low, low, atol=0.5)
        np.testing.assert_allclose(largest[name].high, high, atol=0.5)
        assert 1.0 < largest[name].area < 20.0
    areas = [piece.area for piece in found.pieces]
    assert areas == sorted(areas, reverse=True)


def test_the_other_way_round_is_the_same_with_names_exchanged(pair, moved):
    found = find_contradictions(pair[0], moved, IDENTITY)
    back = find_contradictions(moved, pair[0], IDENTITY)
    assert back.share == pytest.approx(found.share)
    exchanged = {"a": "b", "b": "a"}
    assert {(exchanged[p.occupied_in], p.area, p.low) for p in back.pieces} == {
        (p.occupied_in, p.area, p.low) for p in found.pieces
    }


def test_a_shift_of_some_voxels_is_drift_and_no_change(pair):
    a = pair[0]
    for shift in ((0.4, 0.0, 0.0), (0.0, 0.5, 0.0)):
        assert find_contradictions(a, a, pose(translation=shift)).share < BOUNDS.max_changes


def test_boxes_are_in_the_frame_of_map_a(pair, moved):
    far = pair[0].origin + [1000.0, -500.0, 20.0]
    a = dataclasses.replace(pair[0], origin=far)
    near, away = (find_contradictions(each, moved, IDENTITY).pieces[0] for each in (pair[0], a))
    np.testing.assert_allclose(np.subtract(away.low, near.low), far - pair[0].origin)


def test_a_pose_is_looked_at_once(pair, moved):
    found = find_contradictions(pair[0], moved, IDENTITY)
    assert find_contradictions(pair[0], moved, IDENTITY) is found
    strict = dataclasses.replace(BOUNDS, min_piece_voxels=10_000)
    assert not find_contradictions(pair[0], moved, IDENTITY, strict).pieces
