"""Which poses of a pair can be."""

import numpy as np
import pytest

from small_worlds import pose
from voxjax.registration.hypotheses.pose_range import PoseRange

CENTROID = np.asarray([4.0, 3.0, 1.0], np.float32)
POSES = np.stack(
    [pose(), pose(yaw=30.0), pose(tilt=5.0), pose(tilt=20.0), pose(translation=(2.0, 0.0, 0.0))]
).astype(np.float32)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, [True] * 5),
        ({"max_lean": 8.0}, [True, True, True, False, True]),
        (
            {"guess": np.eye(4, dtype=np.float32), "metres": 1.0, "radians": 0.2},
            [True, False, True, False, False],
        ),
        (
            {"guess": np.eye(4, dtype=np.float32), "metres": 2.5, "radians": 9.0},
            [True, False, True, True, True],
        ),
    ],
)
def test_poses_lean_and_stray_within_bounds(limits, expected):
    assert PoseRange(CENTROID, **limits).admits(POSES).tolist() == expected


def test_no_pose_is_no_problem():
    assert PoseRange(CENTROID, 8.0, np.eye(4, dtype=np.float32), 1.0, 1.0).admits(POSES[:0]).shape == (0,)
