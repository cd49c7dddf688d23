"""Planes of labelled points against singular values, segment by segment."""

import numpy as np

from voxjax.planes.segments import plane_of_segments


def test_planes_are_those_of_the_singular_values():
    rng = np.random.default_rng(0)
    points, normals, labels = [], [], []
    for label in range(4):
        spread = rng.normal(size=(30, 3)) * (3.0, 2.0, 0.05)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        points.append(spread @ turn.T + rng.normal(size=3))
        normals.append(np.tile(turn[:, 2] * (-1) ** label, (30, 1)))
        labels.append(np.full(30, label))
    points, normals, labels = map(np.concatenate, (points, normals, labels))
    shuffled = rng.permutation(len(points))
    points, normals, labels = points[shuffled], normals[shuffled], labels[shuffled].astype(np.int32)
    labels[::9] = -1
    found = plane_of_segments(points, normals, labels, 4)
    for label in range(4):
        own = points[labels == label]
        _, sizes, axes = np.linalg.svd(own - own.mean(axis=0))
        assert found.count[label] == len(own)
        np.testing.assert_allclose(found.centroid[label], own.mean(axis=0), atol=1e-9)
        assert abs(found.normal[label] @ axes[2]) > 1 - 1e-9
        assert found.normal[label] @ normals[labels == label][0] > 0
        np.testing.assert_allclose(found.rms[label], sizes[2] / np.sqrt(len(own)), rtol=1e-6)
        distance = found.distance(own, np.full(len(own), label))
        np.testing.assert_allclose(np.sqrt((distance**2).mean()), found.rms[label], rtol=1e-6)


def test_too_few_points_take_their_mean_normal():
    points, normals = np.asarray([[1.0, 2.0, 3.0]]), np.asarray([[0.0, 1.0, 0.0]])
    found = plane_of_segments(points, normals, np.zeros(1, np.int32), 2)
    np.testing.assert_allclose(found.normal, [[0, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(found.count, [1, 0])
