"""What all terms have in common: thinned ones weigh as much."""

import jax.numpy as jnp
import numpy as np
import pytest

from refinement_problems import one_term
from voxjax.refinement.residuals.terms import Level

KINDS = ["planes", "distances", "occupancies"]
LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


@pytest.mark.parametrize("kind", KINDS)
def test_thinned_terms_weigh_as_much(prepared, start, kind):
    term = one_term(prepared, kind)
    thin = term.thinned(8)
    assert thin.sample.weights.shape == (32,)
    np.testing.assert_allclose(thin.sample.weights.sum(), term.sample.weights.sum(), rtol=1e-5)
    np.testing.assert_allclose(
        thin.rows(start, LEVEL)[:, 3] ** 2, 8 * term.rows(start, LEVEL)[:, 24] ** 2, rtol=1e-4
    )
