"""Hypotheses of each source on a small building seen in two frames, and the leaders among them."""

import numpy as np
import pytest

from small_worlds import OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax import rigid
from voxjax.maps.prepared import prepare_map
from voxjax.metrics import pose_error
from voxjax.ops.evidence.nearest import split_keys
from voxjax.ops.evidence.scoring import HIT
from voxjax.registration.hypotheses.corners import corner_frames, frame_poses, subgraph_poses
from voxjax.registration.hypotheses.distinct import distinct_poses
from voxjax.registration.hypotheses.exhaustive import exhaustive_hypotheses, upright_frame
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.hypotheses.proposals import Proposals
from voxjax.registration.hypotheses.ranking import rank_poses
from voxjax.registration.hypotheses.rotations import rotation_hypotheses
from voxjax.registration.hypotheses.settings import EvidenceConfig
from voxjax.registration.judging.leaders import find_leaders, judge_poses
from voxjax.registration.judging.settings import LeaderConfig

T_MAP_WORLD = pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))


@pytest.fixture(scope="module")
def pair():
    a = map_features(draw_map(), max_virtual=64)
    b = map_features(draw_map(T_MAP_WORLD), max_virtual=64)
    return a, b, np.linalg.inv(T_MAP_WORLD)


def nearest_error(poses, truth, centroid):
    errors = [pose_error(T, truth, centroid) for T in poses]
    return min(errors, key=lambda e: e.metres + np.radians(e.degrees) * 4.0)


FEW = LeaderConfig(num_ranked=64, num_refined=16, num_leaders=4)


def proposals(poses):
    return Proposals(poses, ("exhaustive",) * len(poses), len(poses), {})


def exhaustive(a, b, num_peaks=8):
    rotations, _ = rotation_hypotheses(a.normals, b.normals, a.directions, b.directions, is_signed=True)
    return exhaustive_hypotheses(
        a.prepared,
        b.prepared,
        rotations,
        upright_frame(a.directions, a.shares),
        conflict_weight=3.0,
        num_peaks=num_peaks,
    )


def test_exhaustive_search_puts_the_truth_first(pair):
    a, b, truth = pair
    poses, scores = exhaustive(a, b)
    assert (np.diff(scores) <= 0).all()
    error = pose_error(poses[0], truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 3.0
    assert error.metres < 0.5


def test_corner_frames_propose_the_truth(pair):
    a, b, truth = pair
    found = frame_poses(a.corners, b.corners)
    assert len(found.poses) == len(found.is_observed) > 0
    for T in found.poses[:: max(len(found.poses) // 20, 1)]:
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-5)
        assert np.linalg.det(T[:3, :3]) > 0
    error = nearest_error(found.poses, truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 3.0
    assert error.metres < 0.3


def test_the_common_subgraph_proposes_the_truth(pair):
    a, b, truth = pair
    found = subgraph_poses(a.corners, b.corners, distance_tolerance=0.3)
    assert found.clique_size >= 5
    error = nearest_error(found.poses, truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 3.0
    assert error.metres < 0.3


def test_frames_are_orthonormal_and_nearest():
    rng = np.random.default_rng(0)
    normals = (np.eye(3) + 0.05 * rng.normal(size=(10, 3, 3))).astype(np.float32)
    frames = corner_frames(normals)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (10, 1, 1)), atol=1e-6)
    assert (np.einsum("kij,kji->k", frames, normals.astype(float)) > 2.9).all()


def test_leaders_begin_with_the_refined_truth(pair):
    a, b, truth = pair
    poses, _ = exhaustive(a, b)
    leaders = find_leaders(a.prepared, b.prepared, proposals(poses), FEW, EvidenceConfig())
    error = pose_error(leaders.poses[0], truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 0.5
    assert error.metres < 0.06
    scores = leaders.judgement.score()
    assert (np.diff(scores) <= 0).all()
    assert scores[0] > 0.6
    assert len(leaders.sources) == len(leaders.poses) <= 4


def test_evidence_is_the_same_from_both_sides(pair):
    a, b, truth = pair
    T = np.stack([truth, pose(yaw=50.0) @ truth]).astype(np.float32)
    forward = judge_poses(a.prepared, b.prepared, T, num_points=None)
    backward = judge_poses(b.prepared, a.prepared, rigid.inverse(T), num_points=None)
    for one, two in ((forward.hits, backward.hits), (forward.conflicts, backward.conflicts)):
        np.testing.assert_allclose(one, two, atol=1e-5)
    spectrum = np.linalg.eigvalsh(forward.information), np.linalg.eigvalsh(backward.information)
    np.testing.assert_allclose(*spectrum, atol=1e-5)


def test_a_map_upon_itself_agrees_in_all_directions(pair):
    a = pair[0].prepared
    found = judge_poses(a, a, np.eye(4, dtype=np.float32)[None], num_points=None)
    np.testing.assert_allclose(found.hits, 1.0, atol=1e-4)
    np.testing.assert_allclose(found.conflicts, 0.0, atol=1e-6)
    assert (3 * np.linalg.eigvalsh(found.information[0])).min() > 0.6


def test_another_building_gets_no_support():
    a = map_features(draw_map(), max_virtual=64)
    stranger = draw_map(T_MAP_WORLD, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)
    b = map_features(stranger, max_virtual=64)
    poses, _ = exhaustive(a, b)
    assert rank_poses(a.prepared, b.prepared, poses[:1], num_points=512, conflict_weight=3.0)[0] < 0.5
    leaders = find_leaders(a.prepared, b.prepared, proposals(poses), FEW, EvidenceConfig())
    assert leaders.judgement.score()[0] < 0.25


def test_distinct_poses_keep_the_best_of_each_neighbourhood():
    poses = np.stack([pose(translation=(x, 0, 0)) for x in (0.0, 0.1, 1.0)] + [pose(yaw=20.0)])
    kept = distinct_poses(
        poses, np.zeros(3), scores=np.asarray([0.5, 0.9, 0.2, 0.1]), metres=0.3, degrees=5.0, max_count=10
    )
    assert kept.tolist() == [1, 2, 3]
    few = distinct_poses(poses, np.zeros(3), metres=0.3, degrees=5.0, max_count=2)
    assert few.tolist() == [0, 2]


@pytest.mark.parametrize(("voxel_size", "factor"), [(0.12, 3), (0.15, 2), (0.2, 2), (0.4, 2)])
def test_unrefined_poses_are_compared_in_cells_of_about_0_3_m(voxel_size, factor):
    prepared = prepare_map(draw_map(voxel_size=voxel_size))
    assert prepared.coarse_factor == factor
    # Looser than the evidence of refined poses, and no looser than three quarters of a cell.
    hits, coarse_hits = (
        np.asarray(codes) == HIT for codes in (prepared.codes, prepared.coarse_codes(factor))
    )
    assert (coarse_hits >= hits).all()
    squared = np.asarray(split_keys(prepared.keys)[1])
    assert squared[coarse_hits].max() <= (0.75 * factor) ** 2
