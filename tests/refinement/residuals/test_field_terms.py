"""Terms that read fields hold the cells that they met, and bring points of either map into the other."""

import jax.numpy as jnp
import numpy as np
import pytest

from refinement_problems import one_term
from voxjax import rigid
from voxjax.refinement.residuals.terms import Level

LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


@pytest.mark.parametrize("kind", ["distances", "occupancies"])
def test_residuals_are_those_of_the_cells_that_were_met(prepared, start, kind):
    term = one_term(prepared, kind)
    held = term.holding(term.met(start))
    np.testing.assert_array_equal(held.rows(start, LEVEL), term.rows(start, LEVEL))
    np.testing.assert_array_equal(held.points(), term.sample.points)
    np.testing.assert_array_equal(held.weights(), term.sample.weights)
    # Cells stay where they were met.
    other = start.at[0, 3].add(1.0)
    assert np.abs(np.asarray(term.rows(other, LEVEL)) - np.asarray(held.rows(other, LEVEL))).max() > 0


def test_the_other_way_round_the_inverse_pose_is_applied(prepared, start):
    there = one_term(prepared, "distances")
    back = type(there)(there.field, there.sample, there.loss, True)
    np.testing.assert_allclose(
        back.rows(rigid.inverse(start), LEVEL), there.rows(start, LEVEL), rtol=1e-3, atol=1e-4
    )
