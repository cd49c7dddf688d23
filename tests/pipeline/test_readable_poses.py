"""Poses as a person reads them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from oracles.motions import turned
from voxjax.frames import from_local
from voxjax.pipeline.readable_poses import describe_pose, readable_pose

FAR_A, FAR_B = np.array([450_000.0, 5_400_000.0, 300.0]), np.array([450_010.0, 5_400_020.0, 301.0])


def test_near_zero_a_pose_is_its_translation_and_its_angles():
    text = describe_pose(turned("z", np.radians(30.0), (1.0, -2.0, 0.0)), np.array([3.0, 4.0, 1.0]), 0.1)
    assert text == "x 1.000, y -2.000, z 0.000 m; roll 0.00, pitch 0.00, yaw 30.00 deg"


def test_far_out_the_middle_says_how_far_the_map_moves():
    # A turn about the middle of map b, which lies 10 m east and 20 m north of a's, and a step of 0.25 m up.
    T = from_local(turned("z", np.radians(5.0), (0.0, 0.0, 0.25)), FAR_B, FAR_B)
    assert np.abs(T[:3, 3]).max() > 1e5
    text = describe_pose(T, FAR_B, 0.1)
    moved = "its middle (450010.0, 5400020.0, 301.0) moves by x 0.000, y 0.000, z 0.250 m"
    assert text == f"{moved}; roll 0.00, pitch 0.00, yaw 5.00 deg"


def test_of_two_far_frames_with_origins_of_their_own_the_way_is_the_one_between_them():
    pose = readable_pose(from_local(np.eye(4), FAR_A, FAR_B), FAR_B)
    np.testing.assert_allclose(pose.shift, FAR_A - FAR_B, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_angles_are_those_of_fixed_axes(seed):
    angles = np.random.default_rng(seed).uniform((-180, -90, -180), (180, 90, 180))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    pose = readable_pose(T, np.zeros(3))
    np.testing.assert_allclose(pose.degrees, angles, atol=1e-9)
    assert set(pose.as_dict()) == {"roll_pitch_yaw_degrees", "middle_b", "middle_shift"}
