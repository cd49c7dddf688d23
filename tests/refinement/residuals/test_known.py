"""Corner pairs and priors against their definition."""

import jax.numpy as jnp
import numpy as np

from oracles.motions import moved
from oracles.refinement import loss_of
from voxjax.refinement.residuals.known import CornerPairs, Prior, tangent_between
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.equations import move_about

LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


def test_corner_pairs_and_the_prior_follow_their_definition(prepared, start):
    rng = np.random.default_rng(1)
    of_b, of_a = rng.normal(size=(2, 7, 3)).astype(np.float32)
    share = rng.uniform(0, 1, 7).astype(np.float32)
    rows = np.asarray(CornerPairs(of_a=of_a, of_b=of_b, share=share, loss="huber").rows(start, LEVEL))
    gap = moved(np.asarray(start, np.float64), of_b) - of_a
    expected = [
        w * loss_of(g @ g / 0.15**2, "huber") for w, g in zip(share, gap.astype(np.float64), strict=True)
    ]
    np.testing.assert_allclose((rows**2).sum(axis=0), expected, rtol=1e-4)

    centroid = jnp.asarray(prepared[1].centroid)
    tangent = jnp.asarray([0.1, -0.2, 0.3, 0.05, 0.02, -0.04], jnp.float32)
    root = jnp.asarray(rng.normal(size=(6, 6)), jnp.float32)
    there = move_about(start, centroid, tangent)
    np.testing.assert_allclose(tangent_between(start, there, centroid), tangent, atol=3e-6)
    np.testing.assert_allclose(
        Prior(start, centroid, root).rows(there, LEVEL)[:, 0], root @ tangent, atol=1e-4
    )
