import numpy as np

from voxjax.ops.surface.axes import WindowSums, central_sums, principal_axes, surface_normal
from voxjax.ops.surface.ball_sums import ball_offsets


def test_the_widest_window_overflows_nothing():
    offsets = ball_offsets(25).astype(np.int64)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    for kept in (offsets, offsets[offsets[:, 0] > 0], offsets[offsets[:, 0] * offsets[:, 1] > 0]):
        second = [(kept[:, i] * kept[:, j]).sum() for i, j in pairs]
        one = [len(kept), *kept.sum(axis=0), *second, len(kept), *-kept.sum(axis=0)]
        central = central_sums(np.asarray(one, np.int32)[:, None])
        covariance = np.cov(kept.T, bias=True)
        expected = [covariance[i, j] for i, j in pairs]
        np.testing.assert_allclose(np.asarray(central.covariance)[:, 0], expected, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(np.asarray(central.lean)[:, 0], -2 * kept.sum(axis=0), rtol=1e-6)


def test_axes_are_the_eigenvectors_of_the_covariance():
    rng = np.random.default_rng(1)
    factors = rng.normal(size=(50, 3, 3)) * rng.uniform(0.2, 3.0, (50, 1, 3))
    covariance = factors @ factors.transpose(0, 2, 1)
    six = np.stack([covariance[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    axes = principal_axes(np.asarray(six, np.float32))
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(axes.curvature, values[:, 0] / values.sum(axis=1), atol=1e-4)
    for found, expected, is_defined in (
        (axes.low, vectors[..., 0], axes.is_low),
        (axes.high, vectors[..., 2], axes.is_high),
    ):
        assert np.asarray(is_defined).all()
        np.testing.assert_allclose(np.abs(np.sum(np.asarray(found).T * expected, axis=1)), 1.0, atol=1e-3)


def test_a_normal_points_to_the_side_on_which_more_is_free():
    covariance = np.tile(np.asarray([[2.0], [1.0], [0.01], [0.0], [0.0], [0.0]], np.float32), 3)
    lean = np.asarray([[0, 0, 0], [0, 0, 0], [50, -50, 0]], np.float32)
    mean = np.asarray([[0, 0, 0], [0, 0, 0], [0.5, 0.5, 0.5]], np.float32)
    sums = WindowSums(np.full(3, 9, np.int32), mean, covariance, lean)
    normal, has_free, offset = surface_normal(sums, principal_axes(covariance))
    np.testing.assert_allclose(np.asarray(normal)[2, :2], [1.0, -1.0], atol=1e-6)
    assert np.asarray(has_free).tolist() == [True, True, False]
    np.testing.assert_allclose(np.asarray(offset)[:2], [0.5, -0.5], atol=1e-6)
