import contextlib

import numpy as np
import pytest

from device_path import device_path
from oracles.evidence import evidence_of_point
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.nearest import nearest_field
from voxjax.ops.evidence.scoring import evidence_codes, score_poses, surface_evidence

VOXEL, ORIGIN = 0.1, np.asarray([-0.5, 0.3, 1.0], np.float32)


@pytest.fixture(scope="module")
def room():
    """A floor and a wall with free space before and unknown behind."""
    rng = np.random.default_rng(0)
    states = np.zeros((14, 12, 10), np.uint8)
    states[2:, 2:, 2:] = 1
    states[2:, 2:, 1] = 2
    states[1, 2:, 2:] = 2
    states[rng.random(states.shape) < 0.03] = 2
    return states


def block_of(states):
    index = np.argwhere(states == 2).astype(np.int32)
    dims = np.asarray(states.shape, np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=states.size, radius=5)
    codes = evidence_codes(states.reshape(-1), keys, 2, 4)
    return index, keys, codes, Block(dims, ORIGIN, np.float32(VOXEL))


def some_poses(rng):
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4, dtype=np.float32), (5, 1, 1))
    poses[1:, :3, :3] = Rotation.random(4, rng=np.random.default_rng(3)).as_matrix()
    poses[1:, :3, 3] = rng.normal(0, 0.3, (4, 3)) + ORIGIN
    return poses


@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
def test_score_equals_the_definition(room, form):
    rng = np.random.default_rng(1)
    _, _, codes, block = block_of(room)
    points = rng.uniform(-1, 2, (80, 3)).astype(np.float32)
    weights = rng.random(80).astype(np.float32)
    poses = some_poses(rng)
    with form():
        found = np.asarray(score_poses(codes, block, points, weights, poses))
    for T, sums in zip(poses.astype(np.float64), found, strict=True):
        names = [evidence_of_point(room, ORIGIN, VOXEL, T[:3, :3] @ p + T[:3, 3], 2, 4) for p in points]
        expected = [weights[np.asarray(names) == n].sum() for n in ("hit", "conflict", "neutral")]
        np.testing.assert_allclose(sums, expected, atol=1e-5)


def test_points_of_the_map_itself_are_hits(room):
    index, _, codes, block = block_of(room)
    points = (ORIGIN + (index + 0.5) * VOXEL).astype(np.float32)
    weights = np.full(len(points), 1 / len(points), np.float32)
    sums = np.asarray(score_poses(codes, block, points, weights, np.eye(4, dtype=np.float32)[None]))
    np.testing.assert_allclose(sums, [[1, 0, 0]], atol=1e-5)


def test_a_surface_that_faces_the_other_way_is_no_hit(room):
    index, keys, codes, block = block_of(room)
    points = (ORIGIN + (index + 0.5) * VOXEL).astype(np.float32)
    normals = np.tile(np.asarray([0, 0, 1], np.float32), (len(points), 1))
    weights = np.full(len(points), 1 / len(points), np.float32)
    identity = np.eye(4, dtype=np.float32)[None]

    def judge(other, is_signed):
        return surface_evidence(codes, keys, block, normals, points, other, weights, identity, is_signed)

    same, information = judge(normals, True)
    np.testing.assert_allclose(np.asarray(same), [[1, 0, 0, 0]], atol=1e-5)
    np.testing.assert_allclose(np.asarray(information)[0], np.diag([0, 0, 1]), atol=1e-5)
    opposed, information = judge(-normals, True)
    np.testing.assert_allclose(np.asarray(opposed), [[0, 0, 0, 1]], atol=1e-5)
    np.testing.assert_allclose(np.asarray(information), 0, atol=1e-6)
    unsigned, _ = judge(-normals, False)
    np.testing.assert_allclose(np.asarray(unsigned), [[1, 0, 0, 0]], atol=1e-5)
    unknown, _ = judge(np.zeros_like(normals), True)
    np.testing.assert_allclose(np.asarray(unknown), [[1, 0, 0, 0]], atol=1e-5)


@pytest.mark.parametrize(("num_points", "num_poses"), [(0, 3), (7, 0), (0, 0)])
def test_no_points_and_no_poses_give_empty_sums(room, num_points, num_poses):
    index, keys, codes, block = block_of(room)
    points, weights = np.zeros((num_points, 3), np.float32), np.zeros(num_points, np.float32)
    poses = np.tile(np.eye(4, dtype=np.float32), (num_poses, 1, 1))
    normals = np.zeros((len(index), 3), np.float32)
    scores = np.asarray(score_poses(codes, block, points, weights, poses))
    sums, information = surface_evidence(codes, keys, block, normals, points, points, weights, poses, True)
    for found, shape in ((scores, (3,)), (sums, (4,)), (information, (3, 3))):
        np.testing.assert_array_equal(np.asarray(found), np.zeros((num_poses, *shape)))


@pytest.mark.parametrize("num_points", [1024, 4097, 20000])
def test_lists_of_several_pieces_add_up_to_their_points(room, num_points):
    rng = np.random.default_rng(5)
    index, keys, codes, block = block_of(room)
    surface = rng.normal(size=(len(index), 3)).astype(np.float32)
    surface /= np.linalg.norm(surface, axis=1, keepdims=True)
    few = rng.uniform(-1, 2, (100, 3)).astype(np.float32)
    normals = surface[rng.integers(0, len(surface), 100)]
    weights = rng.random(100).astype(np.float32)
    poses, chosen = some_poses(rng), rng.integers(0, 100, num_points)
    times = np.bincount(chosen, minlength=100).astype(np.float32)
    points, sides, shares = few[chosen], normals[chosen], weights[chosen]
    found = surface_evidence(codes, keys, block, surface, points, sides, shares, poses, True)
    expected = surface_evidence(codes, keys, block, surface, few, normals, weights * times, poses, True)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=2e-4, atol=0.02)
    scores = score_poses(codes, block, points, shares, poses)
    in_one = score_poses(codes, block, few, weights * times, poses)
    np.testing.assert_allclose(np.asarray(scores), np.asarray(in_one), rtol=2e-4, atol=0.02)
    assert np.asarray(in_one).max() > 0.02 * num_points
