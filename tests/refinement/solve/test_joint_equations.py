import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax.refinement.solve.joint_equations import JointEquations, dense_step, sparse_step


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_factors_and_conjugate_gradients_give_the_same_step(dtype):
    rng = np.random.default_rng(2)
    first = np.array([0, 1, 2, 3, 4, 0])
    second = np.array([1, 2, 3, 4, 5, 3])
    rows = rng.normal(size=(6, 8, 12))
    whole = np.zeros((6, 6, 6, 6))
    for a, b, jacobian in zip(first, second, rows, strict=True):
        whole[np.ix_([a, b], range(6), [a, b], range(6))] += (jacobian.T @ jacobian).reshape(2, 6, 2, 6)
    slope = rng.normal(size=(6, 6))
    with jax.enable_x64(dtype == np.float64):
        equations = JointEquations(
            jnp.zeros((), dtype),
            jnp.asarray(slope, dtype),
            jnp.asarray(whole[range(6), :, range(6), :], dtype),
            jnp.asarray(whole[first, :, second, :], dtype),
            jnp.asarray(first, jnp.int32),
            jnp.asarray(second, jnp.int32),
        )
        damped = equations.damped(jnp.asarray(0.1, dtype))
        dense = whole.reshape(36, 36)
        expected = -np.linalg.solve(dense + 0.1 * np.diag(np.diag(dense)), slope.reshape(-1)).reshape(6, 6)
        np.testing.assert_allclose(dense_step(damped), expected, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(sparse_step(damped), dense_step(damped), rtol=1e-3, atol=1e-3)
