import contextlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from device_path import device_path
from voxjax.ops.evidence.exact import exact_information
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.nearest import nearest_field
from voxjax.ops.evidence.scoring import evidence_codes

VOXEL, ORIGIN, REACH = 0.1, np.asarray([-0.5, 0.3, 1.0], np.float32), 0.05


@pytest.fixture(scope="module")
def surface():
    """Fields of a map of scattered voxels, each with a plane of its own; some have none."""
    rng = np.random.default_rng(0)
    states = np.ones((14, 12, 10), np.uint8)
    states[rng.random(states.shape) < 0.05] = 2
    index = np.argwhere(states == 2).astype(np.int32)
    dims = np.asarray(states.shape, np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=states.size, radius=5)
    codes = evidence_codes(states.reshape(-1), keys, 2, 4)
    normals = rng.normal(size=index.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[rng.random(len(index)) < 0.2] = 0.0
    anchors = ORIGIN + (index + 0.5) * VOXEL + 0.3 * VOXEL * normals
    return index, keys, codes, Block(dims, ORIGIN, np.float32(VOXEL)), anchors, normals


def some_points(surface, count=200):
    """Points near voxels, half of them on planes that are turned nearly like theirs."""
    index, *_, anchors, normals = surface
    rng = np.random.default_rng(1)
    row = rng.integers(0, len(index), count)
    points = anchors[row] + rng.normal(scale=0.03, size=(count, 3))
    sides = normals[row] * rng.choice((-1.0, 1.0), (count, 1)) + rng.normal(scale=0.12, size=(count, 3))
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    return points.astype(np.float32), sides.astype(np.float32), rng.random(count).astype(np.float32)


def by_definition(surface, points, sides, weights, T, is_signed):
    """The information by a loop over the points; also how many of them count."""
    index, _, _, block, anchors, normals = surface
    total, count = np.zeros((3, 3)), 0
    for point, side, weight in zip(
        points @ T[:3, :3].T + T[:3, 3], sides @ T[:3, :3].T, weights, strict=True
    ):
        cell = np.floor((point - ORIGIN) / VOXEL)
        if (cell < 0).any() or (cell >= block.dims).any():
            continue
        squared = ((index - cell) ** 2).sum(axis=1)
        row = squared.argmin()
        cosine = side @ normals[row] if is_signed else abs(side @ normals[row])
        if squared[row] <= 2 and abs((point - anchors[row]) @ normals[row]) <= REACH and cosine >= 0.9:
            total += weight * np.outer(normals[row], normals[row])
            count += 1
    return total, count


@pytest.mark.parametrize("is_signed", [True, False])
@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
def test_information_equals_the_definition(surface, form, is_signed):
    points, sides, weights = some_points(surface)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, :3, 3] = 0.02, -0.01, 0.01
    poses[2, :3, :3] = Rotation.from_rotvec([0.02, 0.01, -0.02]).as_matrix()
    _, keys, codes, block, anchors, normals = surface
    with form():
        found = exact_information(
            codes,
            keys,
            block,
            anchors.astype(np.float32),
            normals.astype(np.float32),
            points,
            sides,
            weights,
            poses.astype(np.float32),
            is_signed,
            reach=REACH,
        )
    for T, information in zip(poses, np.asarray(found), strict=True):
        expected, count = by_definition(surface, points, sides, weights, T, is_signed)
        assert count > 5
        np.testing.assert_allclose(information, expected, atol=1e-4)


def test_planes_beside_each_other_or_across_do_not_count(surface):
    _, keys, codes, block, anchors, normals = surface
    anchors, normals = anchors.astype(np.float32), normals.astype(np.float32)
    weights, identity = np.ones(len(anchors), np.float32), np.eye(4, dtype=np.float32)[None]

    def trace(points, sides):
        found = exact_information(
            codes, keys, block, anchors, normals, points, sides, weights, identity, True, reach=REACH
        )
        return float(np.trace(np.asarray(found)[0]))

    has_plane = int(np.count_nonzero(normals.any(axis=1)))
    assert trace(anchors, normals) == pytest.approx(has_plane, rel=1e-4)
    across = np.roll(normals, 1, axis=1) - normals * np.sum(
        np.roll(normals, 1, axis=1) * normals, axis=1, keepdims=True
    )
    assert trace(anchors, across) == 0.0
    assert trace(anchors, -normals) == 0.0
    beside = trace(anchors + 2.0 * REACH * normals, normals)
    assert beside < 0.2 * has_plane
