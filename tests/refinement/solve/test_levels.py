"""What a descent gives is never worse than its start, and a start that is the solution has its derivative."""

import jax
import jax.numpy as jnp
import numpy as np

from voxjax.refinement.residuals.known import CornerPairs
from voxjax.refinement.solve.levels import no_worse
from voxjax.refinement.solve.problem import PoseProblem

SCALES = jnp.asarray([0.2, 0.1], jnp.float32)
# The cost is lowest where the translation along x is 1.
PAIR = CornerPairs(
    of_a=np.asarray([[1, 0, 0]], np.float32),
    of_b=np.zeros((1, 3), np.float32),
    share=np.ones(1, np.float32),
    loss="squared",
)
VALLEY = PoseProblem((PAIR,), np.zeros(3, np.float32), np.asarray(1.0, np.float32))


def at(x):
    return jnp.eye(4, dtype=jnp.float32).at[0, 3].set(x)


def test_the_cheaper_of_start_and_found_is_kept():
    kept, before, after = no_worse(VALLEY, at(0.0), at(0.9), SCALES)
    np.testing.assert_allclose([kept[0, 3], before / after], [0.9, 100.0], rtol=1e-4)
    kept, before, after = no_worse(VALLEY, at(0.7), at(0.1), SCALES)
    np.testing.assert_allclose([kept[0, 3], before / after], [0.7, 1.0], rtol=1e-4)


def test_a_start_that_is_the_solution_keeps_the_derivative_of_the_solution():
    def kept(x, gap):
        return no_worse(VALLEY, jax.lax.stop_gradient(at(x - gap)), at(x), SCALES)[0][0, 3]

    assert float(jax.grad(kept)(jnp.float32(1.0), 0.0)) == 1.0
    assert float(jax.grad(kept)(jnp.float32(1.5), 0.5)) == 0.0
