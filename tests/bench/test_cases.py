"""Cases of the registration benchmark: variants of maps keep their truth, poses are judged."""

import json

import numpy as np
import pytest
from bench.cases import Case, folder_cases, motion_about, moved_truth, rotation_kind
from bench.worlds import MapPair
from scipy.spatial.transform import Rotation

import voxjax as vx
from oracles.motions import pose_of


def turn(rotvec, translation=(0.0, 0.0, 0.0)):
    return pose_of(Rotation.from_rotvec(rotvec).as_matrix(), translation)


def apply(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def no_maps() -> MapPair:
    raise AssertionError


@pytest.fixture
def cloud_folder(tmp_path):
    """One real pair of clouds, the second moved by the truth's inverse."""
    rng = np.random.default_rng(3)
    points_a = np.concatenate([rng.uniform(0, 5, (300, 3)) * mask for mask in (1 - np.eye(3))])
    T_a_b = turn([0.1, -0.3, 1.0], [4.0, -2.0, 0.5])
    points_b = apply(np.linalg.inv(T_a_b), points_a)
    folder = tmp_path / "real" / "cloud"
    folder.mkdir(parents=True)
    for name, points in (("a", points_a), ("b", points_b)):
        header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
        header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
        lines = "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points)
        (folder / f"{name}.ply").write_text(header + lines)
    truth = {
        "kind": "pair",
        "T_a_b": T_a_b.tolist(),
        "resolution": 0.1,
        "rot_tol_deg": 1.5,
        "trans_tol_m": 0.1,
        "overlap_b_in_a": 0.9,
        "overlap_a_in_b": 0.8,
    }
    (folder / "truth.json").write_text(json.dumps(truth))
    return tmp_path


def test_moved_truth_maps_the_moved_points_onto_each_other():
    rng = np.random.default_rng(0)
    points_b = rng.normal(size=(20, 3))
    T_a_b = turn([0.3, 1.0, -0.4], [3.0, 2.0, 1.0])
    points_a = apply(T_a_b, points_b)
    move_a, move_b = motion_about(points_a, rng), motion_about(points_b, rng)
    moved = apply(moved_truth(T_a_b, move_a, move_b), apply(move_b, points_b))
    np.testing.assert_allclose(moved, apply(move_a, points_a), atol=1e-9)


def test_a_motion_turns_about_the_centroid():
    points = np.random.default_rng(1).uniform(100, 110, (50, 3))
    shift = apply(motion_about(points, np.random.default_rng(2)), points).mean(axis=0) - points.mean(axis=0)
    assert np.abs(shift).max() <= 15.0


def test_variants_of_a_cloud_keep_truth_and_tolerances(cloud_folder):
    cases = folder_cases(cloud_folder, ["real"], num_reframings=1, with_half=True, seed=5)
    assert [case.source for case in cases] == ["real", "re-framed", "half"]
    assert len({case.name for case in cases}) == 3
    for case in cases:
        pair = case.load()
        assert (case.degrees, case.metres, pair.overlap) == (1.5, 0.1, 0.8)
        assert pair.T_a_b is not None
        moved = apply(pair.T_a_b, pair.b.occupied_points())
        distance = np.linalg.norm(moved[:, None] - pair.a.occupied_points()[None], axis=-1).min(axis=1)
        # Centres are at most half a diagonal of a voxel from their points, in either map.
        assert distance.max() <= np.sqrt(3) * pair.a.voxel_size + 1e-5


def test_turns_by_right_angles_keep_every_voxel_and_upright_ones_the_vertical(cloud_folder):
    case = folder_cases(cloud_folder, ["real"])[0].load()
    (cube,) = folder_cases(cloud_folder, ["real"], num_reframings=1, turns="cube", seed=5)[1:]
    assert cube.name.endswith("~cube_5_0")
    pair = cube.load()
    assert (pair.a.num_occupied, pair.b.num_occupied) == (case.a.num_occupied, case.b.num_occupied)
    moved = apply(pair.T_a_b, pair.b.occupied_points())
    assert np.linalg.norm(moved[:, None] - pair.a.occupied_points()[None], axis=-1).min(axis=1).max() < 0.18
    points = np.random.default_rng(1).uniform(0, 10, (50, 3))
    T = motion_about(points, np.random.default_rng(2), turns="cube", voxel_size=0.25)
    np.testing.assert_array_equal(np.sort(np.abs(T[:3, :3]), axis=1), [[0, 0, 1]] * 3)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(T[:3, 3] / 0.25, np.round(T[:3, 3] / 0.25))
    T = motion_about(points, np.random.default_rng(2), turns="upright")
    np.testing.assert_allclose(T[2, :3], [0, 0, 1])
    assert abs(T[0, 1]) > 0.01


def test_a_reframing_is_the_same_whenever_it_is_made(cloud_folder):
    case = folder_cases(cloud_folder, ["real"], num_reframings=2, seed=5)[2]
    np.testing.assert_array_equal(case.load().T_a_b, case.load().T_a_b)


def test_a_truth_without_maps_is_named(cloud_folder):
    (cloud_folder / "real" / "cloud" / "b.ply").unlink()
    with pytest.raises(vx.InputError, match=r"neither b\.bt nor b\.ply"):
        folder_cases(cloud_folder, ["real"])


def test_judge_takes_the_first_pose_and_ranks_the_first_right_one():
    case = Case("sim/x", "sim", "pair", "yaw", 3.0, 0.4, no_maps, {})
    truth = turn([0.0, 0.0, 0.5], [1.0, 0.0, 0.0])
    far, near = turn([0.0, 0.0, 2.0]), turn([0.0, 0.0, 0.51], [1.0, 0.1, 0.0])
    judged = case.judge([far, near], truth, np.zeros(3))
    assert (judged["right"], judged["rank"]) == (False, 1)
    assert case.judge([near], truth, np.zeros(3))["metres"] == pytest.approx(0.1)
    assert case.judge([], truth, np.zeros(3))["right"] is False
    assert case.judge([near], None, np.zeros(3))["right"] is None


def test_rotation_kind_is_the_lean_of_the_vertical():
    assert rotation_kind(turn([0.0, 0.0, 2.0])) == "yaw"
    assert rotation_kind(turn([0.1, 0.0, 0.0])) == "tilt"
    assert rotation_kind(turn([1.0, 1.0, 0.0])) == "so3"
