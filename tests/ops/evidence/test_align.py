import contextlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from device_path import device_path
from oracles.motions import pose_of
from voxjax.ops.evidence.align import align_poses
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.nearest import nearest_field

VOXEL = 0.1


@pytest.fixture(scope="module")
def box():
    """Surface of a box with its inward normals."""
    size = np.asarray([20, 16, 12])
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in size), indexing="ij"), -1).reshape(-1, 3)
    low, high = cells == 0, cells == size - 1
    is_surface = (low | high).sum(1) == 1
    cells, normals = cells[is_surface], (low.astype(np.float32) - high.astype(np.float32))[is_surface]
    index = (cells + 8).astype(np.int32)
    dims = (size + 16).astype(np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=int(np.prod(dims)), radius=5)
    points = ((index + 0.5) * VOXEL).astype(np.float32)
    return keys, dims, points, normals


def start(points, degrees, metres, seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(np.radians(degrees) * _unit(rng)).as_matrix()
    centre = points.mean(0)
    return pose_of(R, centre - R @ centre + metres * _unit(rng)).astype(np.float32)


def _unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def align(box, poses, weights=None):
    keys, dims, points, normals = box
    weights = np.full(len(points), 1 / len(points), np.float32) if weights is None else weights
    origin = np.zeros(3, np.float32)
    return np.asarray(
        align_poses(
            keys, Block.of(dims, origin, VOXEL), points, normals, points, weights, poses, num_steps=25
        )
    )


@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
def test_poses_a_few_voxels_and_degrees_off_come_back(box, form):
    starts = np.stack([start(box[2], 4.0, 0.2, seed) for seed in range(6)])
    with form():
        found = align(box, starts)
    centre = box[2].mean(0)
    for T in found:
        assert np.linalg.norm(T[:3, :3] @ centre + T[:3, 3] - centre) < 0.01
        assert Rotation.from_matrix(T[:3, :3]).magnitude() < np.radians(0.3)


def test_a_direction_that_nothing_fixes_does_not_move(box):
    keys, dims, points, normals = box
    is_floor = normals[:, 2] > 0
    T = np.eye(4, dtype=np.float32)
    T[:3, 3] = (0.03, -0.02, 0.1)
    weights = (is_floor / is_floor.sum()).astype(np.float32)
    floor = (keys, dims, points, normals * is_floor[:, None].astype(np.float32))
    found = align(floor, T[None], weights)[0]
    np.testing.assert_allclose(found[:2, 3], T[:2, 3], atol=2e-3)
    assert abs(found[2, 3]) < 5e-3


def test_poses_where_nothing_is_near_stay(box):
    T = np.eye(4, dtype=np.float32)
    T[:3, 3] = 500.0
    np.testing.assert_allclose(align(box, T[None])[0], T, atol=1e-4)
