"""Poses from corners: single frames and the maximum common subgraph."""

import numpy as np

from voxjax.metrics import pose_error
from voxjax.registration.hypotheses.corners import corner_frames, frame_poses, strongest, subgraph_poses


def nearest_error(poses, truth, centroid):
    errors = [pose_error(T, truth, centroid) for T in poses]
    return min(errors, key=lambda e: e.metres + np.radians(e.degrees) * 4.0)


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


def test_of_too_many_pairs_the_strongest_are_kept(pair):
    a, b, _ = pair
    every, few = frame_poses(a.corners, b.corners), frame_poses(a.corners, b.corners, max_poses=10)
    assert len(few.poses) == 10 < len(every.poses)
    assert all((T == every.poses).all(axis=(1, 2)).any() for T in few.poses)


def test_the_common_subgraph_proposes_the_truth(pair):
    a, b, truth = pair
    found = subgraph_poses(a.corners, b.corners, distance_tolerance=0.3)
    assert found.clique_size >= 5
    error = nearest_error(found.poses, truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 3.0
    assert error.metres < 0.3


def test_the_strongest_corners_are_observed_ones_first(pair):
    corners = pair[0].corners
    few = strongest(corners, 5)
    assert len(few.mask) == 5
    num_observed = int(np.asarray(corners.trimmed().is_observed).sum())
    assert int(np.asarray(few.is_observed).sum()) == min(5, num_observed)


def test_frames_are_orthonormal_and_nearest():
    rng = np.random.default_rng(0)
    normals = (np.eye(3) + 0.05 * rng.normal(size=(10, 3, 3))).astype(np.float32)
    frames = corner_frames(normals)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (10, 1, 1)), atol=1e-6)
    assert (np.einsum("kij,kji->k", frames, normals.astype(float)) > 2.9).all()
