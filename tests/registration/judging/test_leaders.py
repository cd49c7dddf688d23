"""From many hypotheses to a few distinct, refined leaders."""

import numpy as np

from small_worlds import OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax.metrics import pose_error
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.hypotheses.proposals import Proposals
from voxjax.registration.hypotheses.settings import EvidenceConfig
from voxjax.registration.judging.leaders import find_leaders, merge_leaders
from voxjax.registration.judging.settings import LeaderConfig

FEW = LeaderConfig(num_ranked=64, num_refined=16, num_leaders=4)
WEIGHTS = EvidenceConfig()


def proposals(poses):
    return Proposals(poses, tuple(f"source {k}" for k in range(len(poses))), len(poses), {})


def test_leaders_begin_with_the_refined_truth(pair, exhaustive):
    a, b, truth = pair
    poses, _ = exhaustive(a, b)
    leaders = find_leaders(a.prepared, b.prepared, proposals(poses), FEW, WEIGHTS)
    error = pose_error(leaders.poses[0], truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 0.5
    assert error.metres < 0.06
    scores = leaders.judgement.score()
    assert (np.diff(scores) <= 0).all()
    assert scores[0] > 0.6
    assert len(leaders.sources) == len(leaders.poses) <= 4


def test_how_far_the_refinements_reach_is_what_the_settings_say(pair):
    a, b, truth = pair
    away = (pose(translation=(0.25, 0.0, 0.0)) @ truth)[None].astype(np.float32)

    def gap(**changes):
        options = {"num_ranked": 1, "num_refined": 1, "num_leaders": 1} | changes
        leaders = find_leaders(a.prepared, b.prepared, proposals(away), LeaderConfig(**options), WEIGHTS)
        return pose_error(leaders.poses[0], truth, np.asarray(b.prepared.centroid)).metres

    assert gap() < 0.06
    short = {f"{round}_{end}_distance": 0.01 for round in ("rough", "fine") for end in ("start", "final")}
    assert gap(**short) > 2 * gap()


def test_another_building_gets_no_support(T_map_world, pair, exhaustive):
    stranger = draw_map(T_map_world, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)
    b = map_features(stranger, max_virtual=8)
    poses, _ = exhaustive(pair[0], b)
    leaders = find_leaders(pair[0].prepared, b.prepared, proposals(poses), FEW, WEIGHTS)
    assert leaders.judgement.score()[0] < 0.25


def test_two_sets_become_one_of_distinct_poses_that_keep_their_sources(pair):
    a, b, truth = (pair[0].prepared, pair[1].prepared, pair[2])
    near = np.stack([truth, pose(translation=(0.1, 0.0, 0.0)) @ truth, pose(yaw=90.0) @ truth])
    first = find_leaders(a, b, proposals(near.astype(np.float32)), FEW, WEIGHTS)
    nothing = find_leaders(a, b, proposals(np.zeros((0, 4, 4), np.float32)), FEW, WEIGHTS)
    assert len(nothing.poses) == len(nothing.sources) == 0
    assert len(first.poses) == 2
    assert set(first.sources) <= {"source 0", "source 1", "source 2"}
    for merged in (merge_leaders(a, b, first, nothing, FEW), merge_leaders(a, b, nothing, first, FEW)):
        np.testing.assert_array_equal(merged.poses, first.poses)
        assert merged.sources == first.sources
    twice = merge_leaders(a, b, first, first, FEW)
    np.testing.assert_array_equal(twice.poses, first.poses)
