"""Rejection of false corners against equation (3)."""

import numpy as np

from oracles import surfaces
from voxjax.planes.reject import reject_corners


def test_rejection_is_equation_three():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(6, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    offsets = rng.normal(size=6).astype(np.float32) * 0.3
    points = rng.normal(size=(40, 3)).astype(np.float32) * 0.5
    # All planes are beside all points: one support point of each within the radius.
    support, labels = np.zeros((6, 3), np.float32), np.arange(6, dtype=np.int32)
    keep, rows, worst = reject_corners(
        points,
        normals,
        offsets,
        support,
        labels,
        max_distance=0.3,
        support_radius=50.0,
        min_triple_product=0.3,
    )
    expected = [surfaces.nearest_three(p, normals, offsets, 0.3) for p in points]
    np.testing.assert_allclose(worst, expected, atol=1e-4)
    np.testing.assert_array_equal(keep, np.asarray(expected) < 0.3)
    assert 0 < keep.sum() < 40
    product = np.linalg.det(normals[rows[keep]].astype(np.float64))
    assert (np.abs(product) >= 0.3).all()
    assert (rows[~keep] == -1).all()


def test_planes_without_voxels_beside_a_corner_do_not_count():
    normals, offsets = np.eye(3, dtype=np.float32), np.zeros(3, np.float32)
    point = np.zeros((1, 3), np.float32)
    labels = np.arange(3, dtype=np.int32)
    near = np.full((3, 3), 0.1, np.float32)
    far = near.copy()
    far[2] = 9.0
    for support, expected in ((near, True), (far, False)):
        keep = reject_corners(point, normals, offsets, support, labels, max_distance=0.1, support_radius=1.0)[
            0
        ]
        assert keep.tolist() == [expected]
