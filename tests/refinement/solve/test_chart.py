import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles.motions import random_pose
from voxjax.refinement.residuals.known import tangent_between
from voxjax.refinement.solve.chart import chart_about


@pytest.fixture(scope="module")
def starts():
    rng = np.random.default_rng(5)
    poses = jnp.asarray(np.stack([random_pose(rng) for _ in range(3)]), jnp.float32)
    centroids = jnp.asarray(rng.normal(size=(3, 3)), jnp.float32)
    return poses, centroids, jnp.asarray([1.0, 2.0, 4.0], jnp.float32)


SCALE = jnp.asarray(0.2, jnp.float32)
UNKNOWNS = jnp.asarray(np.random.default_rng(6).normal(size=(3, 6)), jnp.float32)


def test_a_unit_is_a_robust_scale_of_shift_or_of_turn_at_the_radius(starts):
    poses, centroids, radii = starts
    chart = chart_about(poses[1], centroids[1], radii[1], SCALE)
    np.testing.assert_allclose(chart.units, [0.2, 0.2, 0.2, 0.1, 0.1, 0.1], rtol=1e-6)
    np.testing.assert_allclose(chart.poses(jnp.zeros(6, jnp.float32)), poses[1], atol=1e-6)


def test_poses_of_many_maps_are_those_of_each(starts):
    poses, centroids, radii = starts
    many = chart_about(poses, centroids, radii, SCALE, is_fixed=jnp.zeros(3, bool))
    for k in range(3):
        one = chart_about(poses[k], centroids[k], radii[k], SCALE)
        np.testing.assert_allclose(many.poses(UNKNOWNS)[k], one.poses(UNKNOWNS[k]), atol=1e-6)
        np.testing.assert_allclose(many.slopes(UNKNOWNS)[k], one.slopes(UNKNOWNS[k]), atol=1e-6)


def test_maps_that_are_held_stay_and_have_no_slopes(starts):
    poses, centroids, radii = starts
    chart = chart_about(poses, centroids, radii, SCALE, is_fixed=jnp.asarray([False, True, False]))
    moved, slopes = chart.poses(UNKNOWNS), chart.slopes(UNKNOWNS)
    assert jnp.array_equal(moved[1], poses[1])
    assert not slopes[1].any()
    assert (jnp.abs(moved - poses).max(axis=(1, 2)) > 1e-3).tolist() == [True, False, True]


def test_slopes_are_the_derivatives_of_the_tangent_at_the_pose(starts):
    poses, centroids, radii = starts
    chart = chart_about(poses[0], centroids[0], radii[0], SCALE)
    here = chart.poses(UNKNOWNS[0])
    found = jax.jacfwd(lambda unknowns: tangent_between(here, chart.poses(unknowns), centroids[0]))(
        UNKNOWNS[0]
    )
    np.testing.assert_allclose(chart.slopes(UNKNOWNS[0]), found, atol=1e-5)
