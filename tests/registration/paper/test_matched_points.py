import numpy as np
import pytest

from oracles.motions import nudged, pose_error, random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax import VoxelGrid
from voxjax.matching.early_transform import kabsch
from voxjax.registration.paper.matched_points import NeighbouringPoints, align_matches, fit_points

CORNERS = np.array(
    [[1.2, 0.9, 1.0], [3.0, 1.2, 1.6], [3.8, 3.0, 2.0], [2.2, 1.8, 0.9], [0.2, 0.2, 0.2], [5.2, 4.2, 0.2]]
)


@pytest.fixture(scope="module")
def maps():
    a = VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(7), metres=2, degrees=50)
    b = a.transformed(np.linalg.inv(T))
    return NeighbouringPoints(a.occupied_points(), b.occupied_points(), VOXEL), T


def in_frame_b(T, noise, seed):
    """Corners as map b would place them, wrong by `noise` [m]."""
    moved = (CORNERS - T[:3, 3]) @ T[:3, :3]
    return (moved + np.random.default_rng(seed).normal(0, noise, CORNERS.shape)).astype(np.float32)


def test_neighbours_make_the_transform_better_than_the_corners_alone(maps):
    neighbours, T = maps
    gains = []
    for seed in range(4):
        corners_b = in_frame_b(T, 0.6 * VOXEL, seed)
        alone = pose_error(kabsch(CORNERS, corners_b), T, corners_b.mean(axis=0))
        found, _ = align_matches(CORNERS.astype(np.float32), corners_b, neighbours)
        error = pose_error(found, T, corners_b.mean(axis=0))
        assert error[0] < 1.0
        assert error[1] < 0.5 * VOXEL
        gains.append(alone[0] / max(error[0], 1e-9))
    assert np.median(gains) > 1.5


def test_the_early_transform_uses_neighbours_too(maps):
    neighbours, T = maps
    corners_b = in_frame_b(T, 0.6 * VOXEL, 3)[:5]
    found = neighbours.early_align()(CORNERS[:5].astype(np.float32), corners_b)
    assert found.shape == (4, 4)
    assert (
        pose_error(found, T, corners_b.mean(axis=0))[0]
        < pose_error(kabsch(CORNERS[:5], corners_b), T, corners_b.mean(axis=0))[0]
    )


def test_neighbours_lie_within_the_radius_and_come_once(maps):
    neighbours, T = maps
    corners_b = in_frame_b(T, 0.0, 0)
    rows = neighbours.beside(corners_b, radius=0.5, count=1000)
    gaps = np.linalg.norm(neighbours.voxels_b[rows][:, None] - corners_b[None], axis=-1).min(axis=1)
    assert gaps.max() <= 0.5
    every = np.linalg.norm(neighbours.voxels_b[:, None] - corners_b[None], axis=-1).min(axis=1) < 0.5
    assert len(rows) == len(set(rows.tolist())) == np.count_nonzero(every)


def test_pairs_are_the_nearest_voxels_within_reach(maps):
    neighbours, T = maps
    rows = np.arange(0, len(neighbours.voxels_b), 400)
    shifted = nudged(T, np.zeros(3), np.random.default_rng(1), metres=0.1, degrees=2)
    points_a, points_b = neighbours.pairs(rows, shifted, 0.12)
    for p, q in zip(points_a, points_b, strict=True):
        moved = shifted[:3, :3] @ q + shifted[:3, 3]
        nearest = np.linalg.norm(neighbours.voxels_a - moved, axis=1).min()
        assert np.linalg.norm(p - moved) == pytest.approx(nearest, abs=1e-5)
        assert nearest <= 0.12 + 1e-6


def test_fit_equals_the_closed_form_where_all_offsets_are_small():
    rng = np.random.default_rng(2)
    b = rng.uniform(0, 4, (50, 3))
    T = random_pose(rng)
    a = b @ T[:3, :3].T + T[:3, 3] + rng.normal(0, 0.01, b.shape)
    start = nudged(T, b.mean(axis=0), rng, metres=0.05, degrees=1).astype(np.float32)
    weights = np.full(50, 0.02, np.float32)
    pose, converged, steps = fit_points(
        a.astype(np.float32), b.astype(np.float32), weights, start, np.float32(1.0)
    )
    degrees, metres = pose_error(pose, kabsch(a, b), b.mean(axis=0))
    assert bool(converged)
    assert int(steps) > 0
    assert degrees < 0.02
    assert metres < 1e-3


def test_fit_resists_wrong_pairs_and_ignores_padding():
    rng = np.random.default_rng(3)
    b = rng.uniform(0, 4, (60, 3))
    T = random_pose(rng)
    a = b @ T[:3, :3].T + T[:3, 3]
    a[:6] += 1.5
    weights = np.full(60, 1 / 54, np.float32)
    padded = (np.concatenate([x, np.full((4, 3), 9.0)]).astype(np.float32) for x in (a, b))
    weights = np.concatenate([np.full(60, 1 / 60), np.zeros(4)]).astype(np.float32)
    start = nudged(T, b.mean(axis=0), rng, metres=0.05, degrees=1).astype(np.float32)
    pose = fit_points(*padded, weights, start, np.float32(0.05))[0]
    robust, plain = (pose_error(p, T, b.mean(axis=0)) for p in (pose, kabsch(a, b)))
    assert robust[1] < 0.2 * plain[1]
