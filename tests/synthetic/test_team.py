import numpy as np
import pytest

from voxjax.synthetic import Lidar, different_buildings, simulate_hotel, simulate_team

LIDAR = Lidar(num_azimuths=60)


SMALL = {"voxel_size": 0.2, "lidar": LIDAR}


@pytest.mark.parametrize("frame", ["yaw", "tilt", "so3"])
def test_true_poses_align_maps_without_drift(two_rows, frame):
    team = simulate_team(3, building=two_rows, overlap=1.0, frame=frame, drift=0.0, **SMALL)
    assert team.overlap(0, 1) > 0.93
    T, back = team.true_pose(0, 1), team.true_pose(1, 0)
    assert T is not None
    assert back is not None
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(T @ back, np.eye(4), atol=1e-9)
    for pose in team.poses:
        assert pose is not None
        up = pose[:3, :3] @ [0.0, 0.0, 1.0]
        lean = np.degrees(np.arccos(np.clip(up[2], -1, 1)))
        assert {"yaw": lean < 1e-5, "tilt": 2 < lean < 8.01, "so3": lean > 10}[frame]


def test_more_shared_rooms_give_more_overlap(two_rows):
    overlaps = [
        simulate_team(5, building=two_rows, overlap=o, **SMALL).overlap(0, 1) for o in (0.1, 0.5, 1.0)
    ]
    assert overlaps[0] < overlaps[1] < overlaps[2]


def test_same_seed_gives_the_same_bits(two_rows):
    first, again = (simulate_team(6, building=two_rows, overlap=0.2, frame="so3", **SMALL) for _ in range(2))
    for a, b in zip(first.grids, again.grids, strict=True):
        assert a.equals(b)
    assert np.array_equal(first.is_observed, again.is_observed)
    other = simulate_team(7, building=two_rows, overlap=0.2, frame="so3", **SMALL)
    assert not first.grids[0].equals(other.grids[0])


def test_strangers_have_no_pose_and_come_last(two_rows):
    team = simulate_team(
        8, building=two_rows, num_robots=3, num_strangers=1, overlap=0.3, clutter=0.5, **SMALL
    )
    assert [pose is None for pose in team.poses] == [False, False, False, True]
    assert len(team.grids) == len(team.rooms) == 4
    assert team.true_pose(0, 3) is None
    assert team.overlap(0, 3) == 0.0
    assert not team.is_observed[3].any()
    assert team.is_observed[:3].any(axis=1).all()


def test_different_buildings_are_one_robot_and_one_stranger():
    pair = different_buildings(1, overlap=0.1, **SMALL)
    assert len(pair.grids) == 2
    assert pair.poses[1] is None


def test_hotel_team_shares_its_corridor_or_rooms():
    team = simulate_hotel(0, rooms_per_side=2, overlap=0.4, **SMALL)
    assert len(team.shared_rooms) == 2
    assert team.overlap(0, 1) > 0.3
