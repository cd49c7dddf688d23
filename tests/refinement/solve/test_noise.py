"""The covariance through errors of voxels: symmetric, as large as the errors make it, no wider than the prior."""

import jax.numpy as jnp
import numpy as np
import pytest

from oracles.rooms import VOXEL
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.refine import refine
from voxjax.refinement.solve.noise import implicit_covariance


@pytest.fixture(scope="module")
def covariance(room, prepared):
    problem = pose_problem(*prepared, num_points=1024, both_ways=True)
    T = jnp.asarray(refine(prepared[0], prepared[1], room[2], num_points=1024, both_ways=True).T_a_b)

    def of(deviation, patch=0.8, prior=1.0):
        units = np.concatenate([np.full(3, prior), np.full(3, prior / float(problem.radius))])
        return np.asarray(
            implicit_covariance(
                problem,
                T,
                jnp.float32(VOXEL),
                deviation=jnp.float32(deviation),
                patch=jnp.float32(patch),
                prior=jnp.asarray(units, jnp.float32),
            ),
            np.float64,
        )

    return of


def test_it_is_symmetric_positive_and_grows_with_the_square_of_the_errors(covariance):
    small, large = covariance(0.01), covariance(0.02)
    np.testing.assert_allclose(small, small.T, atol=1e-6 * np.abs(small).max())
    assert np.linalg.eigvalsh(small).min() > 0
    np.testing.assert_allclose(np.diag(large), 4 * np.diag(small), rtol=0.02)


def test_errors_that_more_surface_shares_count_for_more(covariance):
    assert np.trace(covariance(0.01, patch=1.6)[:3, :3]) > 1.5 * np.trace(covariance(0.01, patch=0.4)[:3, :3])


def test_it_is_never_wider_than_the_prior(covariance):
    wide = covariance(100.0, prior=0.05)
    assert np.sqrt(np.diag(wide)[:3]).max() < 0.0501
    assert np.sqrt(np.diag(wide)[:3]).min() > 0.04
