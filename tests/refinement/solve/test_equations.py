"""Normal equations of every kind of residual against dense Jacobians."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import rigid
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.residuals.losses import robust_slope
from voxjax.refinement.residuals.terms import Level, PointTerm
from voxjax.refinement.solve.equations import move_about, pose_equations

KINDS = ["planes", "distances", "occupancies"]
LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_inverse", [False, True])
def test_equations_equal_dense_ones(prepared, start, kind, is_inverse):
    """Slope of the cost by autodiff; matrix as the weighted products of dense Jacobians of the offsets."""
    maps, T = (prepared[::-1], rigid.inverse(start)) if is_inverse else (prepared, start)
    problem = pose_problem(*maps, residuals={kind: 1.0}, num_points=256, both_ways=True)
    term = problem.terms[1 if is_inverse else 0]
    held = term.holding(term.met(T))
    assert isinstance(held, PointTerm)
    centroid = jnp.asarray(problem.centroid)
    found = pose_equations([held], T, centroid, LEVEL)

    def cost(tangent):
        rows = held.rows(move_about(T, centroid, tangent), LEVEL)
        return 0.5 * jnp.sum(rows * rows, dtype=jnp.float32)

    def offsets(tangent):
        placed = held.placed(move_about(T, centroid, tangent), jnp.zeros(3, jnp.float32))
        return jnp.stack(list(held.offsets(placed.points, LEVEL)))

    zero = jnp.zeros(6, jnp.float32)
    offset, jacobian = offsets(zero), jax.jacfwd(offsets)(zero)
    slope = held.weights() * robust_slope(jnp.sum(offset * offset, axis=0, dtype=jnp.float32), held.loss)
    matrix = jnp.einsum("kni,knj,n->ij", jacobian, jacobian, slope)
    np.testing.assert_allclose(found.cost, cost(zero), rtol=1e-5)
    np.testing.assert_allclose(found.slope, jax.grad(cost)(zero), atol=2e-5 * float(jnp.abs(matrix).max()))
    np.testing.assert_allclose(found.matrix, matrix, atol=2e-5 * float(jnp.abs(matrix).max()))
