"""Planes fitted to points against singular values."""

import numpy as np
import pytest

from oracles import surfaces
from voxjax.planes.fit import fit_planes


def _clouds(seed, num, offset=0.0):
    rng = np.random.default_rng(seed)
    points, labels, truth = [], [], []
    for k in range(num):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        flat = rng.uniform(-1, 1, (120, 3))
        points.append(
            flat - np.outer(flat @ n, n) + 0.01 * rng.normal(size=(120, 1)) * n + rng.normal(size=3) + offset
        )
        labels.append(np.full(120, k))
        truth.append(n)
    return np.concatenate(points), np.concatenate(labels).astype(np.int32), np.asarray(truth)


@pytest.mark.parametrize("offset", [0.0, 300.0])
def test_least_squares_planes_equal_svd_also_far_from_the_origin(offset):
    points, labels, truth = _clouds(0, 5, offset)
    planes = fit_planes(points, labels, normals=truth[labels]).trimmed()
    assert int(planes.num_found) == 5
    for k in range(5):
        own = points[labels == k]
        normal, centroid = surfaces.plane_by_svd(own)
        assert abs(planes.normal[k] @ normal) > 1 - 1e-5
        assert planes.normal[k] @ truth[k] > 0
        assert planes.normal[k] @ centroid == pytest.approx(planes.offset[k], abs=2e-3 if offset else 1e-4)
        assert planes.num_voxels[k] == 120
        assert planes.rms[k] == pytest.approx(np.sqrt(np.mean(((own - centroid) @ normal) ** 2)), rel=0.05)


def test_huber_loss_holds_against_outliers():
    points, labels, truth = _clouds(1, 3)
    rng = np.random.default_rng(2)
    bad = rng.random(len(points)) < 0.15
    points[bad] += truth[labels[bad]] * rng.uniform(0.2, 0.6, (bad.sum(), 1))

    def worst(**options):
        planes = fit_planes(points, labels, normals=truth[labels], **options).trimmed()
        return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", planes.normal, truth), -1, 1))).max()

    assert worst(huber_scale=0.02, num_rounds=8) < 1.0 < worst()


def test_no_segments_no_planes():
    planes = fit_planes(np.zeros((0, 3)), np.zeros(0, np.int32))
    assert int(planes.num_found) == 0
    assert not np.asarray(planes.mask).any()
    unlabelled = fit_planes(np.ones((5, 3)), np.full(5, -1, np.int32))
    assert int(unlabelled.num_found) == 0
