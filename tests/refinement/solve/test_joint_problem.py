import jax
import jax.numpy as jnp
import numpy as np

from refinement_problems import corner_problem
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.equations import dense_equations, move_about


def test_blocks_equal_the_dense_jacobian():
    with jax.enable_x64(True):
        pairs = [(0, 1), (2, 1), (2, 3), (3, 0), (1, 3)]
        # Of other losses the matrix is that of weighted squares.
        problem, truth = corner_problem(np.random.default_rng(0), 4, pairs, loss="squared")
        assert [group.first.shape[0] for group in problem.edges] == [3, 2]
        poses, level = jnp.asarray(truth), Level(jnp.asarray(0.1), jnp.int32(0))

        def rows(tangents):
            moved = jax.vmap(move_about)(poses, problem.centroids, tangents.reshape(-1, 6))
            return problem.rows(moved, level)

        expected = jax.jit(lambda tangents: dense_equations(rows, tangents))(jnp.zeros(24))
        found = jax.jit(lambda where: problem.equations(where, level))(poses)
        np.testing.assert_allclose(found.cost, expected.cost, rtol=1e-12)
        cost = jax.jit(lambda where: problem.cost(where, level))(poses)
        np.testing.assert_allclose(2 * found.cost, cost, rtol=1e-12)
        np.testing.assert_allclose(found.slope.reshape(-1), expected.slope, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.dense(), expected.matrix, rtol=1e-9, atol=1e-7)
        move = np.random.default_rng(1).normal(size=(4, 6))
        product = np.asarray(expected.matrix) @ move.reshape(-1)
        np.testing.assert_allclose(found.times(move).reshape(-1), product, rtol=1e-9, atol=1e-7)
        falls = -move.reshape(-1) @ (np.asarray(expected.slope) + 0.5 * product)
        np.testing.assert_allclose(found.fall(jnp.asarray(move)), falls, rtol=1e-9)
