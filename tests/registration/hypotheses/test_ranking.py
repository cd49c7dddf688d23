"""The quick ranking of unrefined poses."""

import numpy as np

from small_worlds import OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax import rigid
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.hypotheses.ranking import rank_poses

OPTIONS = {"num_points": 512, "conflict_weight": 3.0}


def test_the_truth_outranks_other_poses_and_both_maps_agree_about_it(pair):
    a, b, truth = (pair[0].prepared, pair[1].prepared, pair[2])
    poses = np.stack([pose(translation=(1.5, 0.0, 0.0)) @ truth, truth, pose(yaw=40.0) @ truth])
    poses = poses.astype(np.float32)
    scores = rank_poses(a, b, poses, **OPTIONS)
    assert scores.argmax() == 1
    assert scores[1] > 0.8
    np.testing.assert_allclose(
        scores, rank_poses(b, a, np.asarray(rigid.inverse(poses)), **OPTIONS), atol=1e-5
    )


def test_conflicts_count_by_their_weight(pair):
    a, b, truth = pair
    wrong = (pose(translation=(1.5, 0.0, 0.0)) @ truth)[None].astype(np.float32)
    light, heavy = (
        rank_poses(a.prepared, b.prepared, wrong, num_points=512, conflict_weight=weight)[0]
        for weight in (0.0, 3.0)
    )
    assert light > heavy


def test_another_building_ranks_low(T_map_world, pair, exhaustive):
    stranger = draw_map(T_map_world, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)
    b = map_features(stranger, max_virtual=8)
    poses, _ = exhaustive(pair[0], b)
    assert rank_poses(pair[0].prepared, b.prepared, poses[:1], **OPTIONS)[0] < 0.5
