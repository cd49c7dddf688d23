"""Conflicts that hang together, on the small building with a cupboard in another place."""

import numpy as np
import pytest

from small_worlds import FURNITURE, draw_map, pose
from voxjax.maps.prepared import prepare_map
from voxjax.registration.judging.conflict_pieces import _pieces, piece_area, weigh_pieces
from voxjax.registration.judging.judgement import judge_poses
from voxjax.registration.judging.leaders import Leaders
from voxjax.registration.judging.settings import VerdictConfig

T_MAP_WORLD = pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))


@pytest.fixture(scope="module")
def maps():
    return (
        prepare_map(draw_map()),
        prepare_map(draw_map(T_MAP_WORLD)),
        np.linalg.inv(T_MAP_WORLD).astype(np.float32),
    )


def test_the_same_building_has_no_pieces(maps):
    a, b, truth = maps
    pieces, shared = piece_area(a, b, truth)
    assert pieces == 0.0
    assert shared > 0.9 * (a.num_points + b.num_points) * a.grid.voxel_size**2
    face = a.grid.voxel_size**2
    assert piece_area(a, a, np.eye(4, dtype=np.float32)) == (0.0, pytest.approx(2 * a.num_points * face))


def test_a_wrong_pose_has_pieces_the_same_from_both_sides(maps):
    a, b, truth = maps
    wrong = (pose(translation=(0.9, 0.0, 0.0)) @ truth).astype(np.float32)
    pieces, shared = piece_area(a, b, wrong)
    assert pieces > 0.05 * shared
    back = piece_area(b, a, np.linalg.inv(wrong).astype(np.float32))
    assert back == (pytest.approx(pieces, rel=0.02), pytest.approx(shared, rel=0.02))


def test_a_moved_cupboard_is_a_piece_of_its_own_size(maps):
    a = maps[0]
    moved = (*FURNITURE[:1], ((2.6, 0.5, 0.0), (3.6, 1.3, 1.9)), *FURNITURE[2:])
    b = prepare_map(draw_map(furniture=moved))
    area, _ = piece_area(a, b, np.eye(4, dtype=np.float32))
    # The cupboard is gone from one place and stands in another: each shows about 5 to 7 m^2 of sides and top, in voxels
    # of slanted steps and double layers up to twice that.
    assert 2.0 < area < 28.0


def test_pieces_in_a_large_box_are_those_in_a_small_one():
    rng = np.random.default_rng(0)
    index = np.argwhere(rng.random((12, 9, 20)) < 0.1) - 5
    whole, apart = _pieces(index), _pieces(index, most=1)
    # Numbers differ, pieces do not.
    assert len(np.unique(whole)) == len(np.unique(apart)) == len(np.unique([whole, apart], axis=1).T) > 10
    spread_out = np.concatenate([index, index + 3_000_000])
    assert len(np.unique(_pieces(spread_out))) == 2 * len(np.unique(whole))


def test_the_cleaner_of_two_rivals_comes_first(maps):
    a, b, truth = maps
    poses = np.stack([(pose(translation=(0.45, 0.0, 0.0)) @ truth), truth]).astype(np.float32)
    judged = judge_poses(a, b, poses, num_points=None)
    # As if the wrong pose had agreed a little better.
    judged = judged._replace(hits=np.asarray([0.9, 0.8]), conflicts=np.zeros(2))
    ranked = weigh_pieces(a, b, Leaders(poses, judged, ("guess", "exhaustive")), VerdictConfig())
    np.testing.assert_array_equal(ranked.poses[0], poses[1])
    assert ranked.sources == ("exhaustive", "guess")
    assert ranked.judgement.pieces[0] < ranked.judgement.pieces[1]
