import jax
import numpy as np
import pytest

from bumpy_patches import bumpy_patch, describe, near
from compilations import assert_compiles_nothing
from oracles.descriptors import histograms, plane_normal
from oracles.motions import random_rotation
from voxjax import InputError
from voxjax.ops.descriptors import fpfh as descriptor
from voxjax.ops.descriptors.fpfh import point_feature_histograms, surface_normals


def rotation(seed):
    return random_rotation(np.random.default_rng(seed)).astype(np.float32)


@pytest.mark.parametrize("num_bins", [4, 5, 11])
def test_histograms_equal_the_definition(num_bins):
    points, normals = bumpy_patch()
    expected = histograms(points.astype(float), normals.astype(float), 0.6, 0.2, num_bins)
    # float32 may put a pair that lies on the border of two bins into the other one
    np.testing.assert_allclose(describe(points, normals, num_bins=num_bins), expected, atol=2e-3)


def test_tiles_of_a_larger_radius_do_not_change_the_histograms():
    points, normals = bumpy_patch()
    wide = point_feature_histograms(points, normals, near(points, 1.5), radius=0.6, spacing=0.2)
    np.testing.assert_allclose(wide, describe(points, normals), atol=1e-6)


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
    normals, variation = surface_normals(points, near(points, 0.5), radius=0.5)
    for i in range(len(points)):
        around = points[np.linalg.norm(points - points[i], axis=1) <= 0.5]
        if len(around) < 4:
            continue
        normal, share = plane_normal(around.astype(float))
        assert abs(normal @ np.asarray(normals)[i]) > 0.999 or share > 0.1
        np.testing.assert_allclose(np.asarray(variation)[i], share, atol=1e-4)


def test_points_with_too_few_neighbours_have_the_largest_variation():
    points = np.array([[0, 0, 0], [1, 0, 0], [9, 9, 9]], np.float32)
    normals, variation = surface_normals(points, near(points, 2.0), radius=2.0)
    np.testing.assert_allclose(variation, 1 / 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-5)


def test_kernels_give_the_same_under_jit_and_vmap():
    points, normals = bumpy_patch()
    tiles = near(points, 0.6)

    def both(p, n):
        found, variation = surface_normals(p, tiles, radius=0.6)
        return found, variation, point_feature_histograms(p, n, tiles, radius=0.6, spacing=0.2)

    expected = *surface_normals(points, tiles, radius=0.6), describe(points, normals)
    for result in (jax.jit(both)(points, normals), jax.vmap(both)(points[None], normals[None])):
        for one, other in zip(result, expected, strict=True):
            np.testing.assert_allclose(np.reshape(one, np.shape(other)), other, atol=1e-4)


def test_nothing_and_one_point_are_described():
    for count in (0, 1):
        points = np.zeros((count, 3), np.float32)
        normals, variation = surface_normals(points, near(points, 1.0), radius=1.0)
        assert normals.shape == (count, 3)
        np.testing.assert_allclose(variation, np.full(count, 1 / 3, np.float32))
        np.testing.assert_array_equal(describe(points, normals), np.zeros((count, 33)))


def test_another_number_of_points_compiles_nothing():
    kernels = (descriptor.pair_bins, descriptor.count_bins, descriptor.closeness)
    kernels += descriptor.is_within, descriptor.monomials, descriptor._fit

    def run(n):
        points, normals = bumpy_patch(1, n=n)
        surface_normals(points, near(points, 0.3), radius=0.3)
        describe(points, normals, radius=0.3)

    run(20)
    with assert_compiles_nothing(*kernels):
        run(1000)
        run(333)


def test_numbers_of_bins_out_of_range_are_refused():
    points, normals = bumpy_patch()
    with pytest.raises(InputError, match="num_bins must be from 2 to 255, got 1"):
        describe(points, normals, num_bins=1)
