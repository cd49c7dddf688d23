"""Which of many poses stand for all that are near them."""

import numpy as np

from small_worlds import pose
from voxjax.registration.hypotheses.distinct import distinct_poses, distinct_rows, least_trace


def test_distinct_poses_keep_the_best_of_each_neighbourhood():
    poses = np.stack([pose(translation=(x, 0, 0)) for x in (0.0, 0.1, 1.0)] + [pose(yaw=20.0)])
    kept = distinct_poses(
        poses, np.zeros(3), scores=np.asarray([0.5, 0.9, 0.2, 0.1]), metres=0.3, degrees=5.0, max_count=10
    )
    assert kept.tolist() == [1, 2, 3]
    few = distinct_poses(poses, np.zeros(3), metres=0.3, degrees=5.0, max_count=2)
    assert few.tolist() == [0, 2]


def test_rotations_alone_are_told_apart_by_their_angle():
    rotations = np.stack([pose(yaw=yaw)[:3, :3] for yaw in (0.0, 3.0, 6.0, -5.0)])
    assert distinct_rows(rotations, degrees=4.0).tolist() == [0, 2, 3]
    assert distinct_rows(rotations, scores=np.asarray([0.0, 1.0, 0.0, 0.0]), degrees=4.0).tolist() == [1, 3]
    assert distinct_rows(rotations[:0], degrees=4.0).tolist() == []


def test_the_trace_tells_the_angle():
    for degrees in (1.0, 10.0, 100.0, 180.0):
        np.testing.assert_allclose(least_trace(degrees), np.trace(pose(yaw=degrees)[:3, :3]), atol=1e-12)
