"""What all terms have in common: thinned ones weigh as much."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refinement_problems import one_term
from voxjax import InputError
from voxjax.refinement.residuals.known import CornerPairs, Prior
from voxjax.refinement.residuals.terms import Level, check_terms

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


def test_terms_with_nan_are_refused_by_the_place_where_it_stands():
    points, share = np.zeros((2, 3), np.float32), np.ones(2, np.float32)
    pairs = CornerPairs(of_a=points, of_b=points, share=np.array([1.0, np.nan], np.float32))
    eye, zero = jnp.eye(4), np.zeros(3, np.float32)
    believed = Prior(eye.at[0, 3].set(jnp.nan), zero, np.eye(6, dtype=np.float32))
    good = CornerPairs(of_a=points, of_b=points, share=share)
    for terms, place in (([good, pairs], r"terms\[1\]\.share"), ([believed], r"terms\[0\]\.T_a_b")):
        with pytest.raises(InputError, match=f"{place} must hold numbers, but some are NaN"):
            check_terms("terms", terms)
    # What is traced has no values to look at.
    assert (
        jax.jit(lambda T: len(check_terms("terms", [Prior(T, zero, np.eye(6, dtype=np.float32))])))(eye) == 1
    )
