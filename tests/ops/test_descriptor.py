import jax
import numpy as np
import pytest

from oracles.descriptors import histograms, neighbors_within, plane_normal
from voxjax.ops.descriptor import point_feature_histograms, surface_normals


def bumpy_patch(seed=0, n=60):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-1, 1, (n, 2))
    points = np.c_[xy, 0.3 * np.sin(3 * xy[:, 0]) + 0.05 * rng.normal(size=n)].astype(np.float32)
    normals = rng.normal(size=(n, 3)) + np.array([0.0, 0.0, 2.0])
    return points, (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return (q * np.sign(np.linalg.det(q))).astype(np.float32)


def describe(points, normals, radius=0.6, capacity=60, **options):
    rows, lengths = neighbors_within(points, radius, capacity)
    return np.asarray(
        point_feature_histograms(points, normals, rows, lengths, radius=radius, spacing=0.2, **options)
    )


@pytest.mark.parametrize("num_bins", [5, 11])
def test_histograms_equal_the_definition(num_bins):
    points, normals = bumpy_patch()
    expected = histograms(points.astype(float), normals.astype(float), 0.6, 0.2, num_bins)
    # float32 may put a pair that lies on the border of two bins into the other one
    np.testing.assert_allclose(describe(points, normals, num_bins=num_bins), expected, atol=2e-3)


@pytest.mark.parametrize("chunk", [1, 7, 512])
def test_chunks_do_not_change_the_histograms(chunk):
    points, normals = bumpy_patch()
    np.testing.assert_allclose(describe(points, normals, chunk=chunk), describe(points, normals), atol=1e-6)


def test_rigid_motions_leave_histograms_as_they_are():
    points, normals = bumpy_patch(3)
    R = rotation(4)
    moved = describe(points @ R.T + np.asarray([1, -2, 3], np.float32), normals @ R.T)
    difference = np.abs(moved - describe(points, normals)).max(axis=1)
    assert np.mean(difference < 1e-3) > 0.9  # the rest has a pair on the border of two bins
    assert difference.max() < 0.2


def test_histograms_tell_convex_from_concave():
    x = np.linspace(-1, 1, 15, dtype=np.float32)
    x, y = (v.reshape(-1) for v in np.meshgrid(x, x))
    points = np.stack([x, y, -np.abs(x)], 1)
    normals = np.stack([np.sign(x), np.zeros_like(x), np.ones_like(x)], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ridge, valley = describe(points, normals), describe(points, -normals)
    middle = np.abs(x) < 0.2
    assert np.linalg.norm(ridge - valley, axis=1)[middle].min() > 0.5


def test_each_histogram_sums_to_one_and_lonely_points_have_none():
    points, normals = bumpy_patch()
    points[0] = 50.0
    sums = (describe(points, normals) ** 2).reshape(len(points), 3, -1).sum(axis=2)
    np.testing.assert_allclose(sums[1:], 1.0, atol=1e-5)
    np.testing.assert_array_equal(sums[0], 0.0)


def test_normals_are_the_directions_of_least_variance():
    points, _ = bumpy_patch(1)
    rows, lengths = neighbors_within(points, 0.8, 60)
    normals, variation = surface_normals(points, rows, lengths, radius=0.5)
    for i in range(len(points)):
        near = points[rows[i][lengths[i] <= 0.5]]
        if len(near) < 4:
            continue
        normal, share = plane_normal(near.astype(float))
        assert abs(normal @ np.asarray(normals)[i]) > 0.999 or share > 0.1
        np.testing.assert_allclose(np.asarray(variation)[i], share, atol=1e-4)


def test_points_with_too_few_neighbours_have_the_largest_variation():
    points = np.array([[0, 0, 0], [1, 0, 0], [9, 9, 9]], np.float32)
    rows, lengths = neighbors_within(points, 2.0, 4)
    normals, variation = surface_normals(points, rows, lengths, radius=2.0)
    np.testing.assert_allclose(variation, 1 / 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-5)


def test_kernels_give_the_same_under_an_outer_jit():
    points, normals = bumpy_patch()
    rows, lengths = neighbors_within(points, 0.6, 60)
    inner = jax.jit(lambda p: point_feature_histograms(p, normals, rows, lengths, radius=0.6, spacing=0.2))
    np.testing.assert_allclose(inner(points), describe(points, normals), atol=1e-5)
