import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax.refinement.residuals.losses import robust_slope, robustify


@pytest.mark.parametrize("loss", ["geman_mcclure", "cauchy", "huber", "squared"])
def test_losses_follow_their_definition_and_have_a_slope_at_zero(loss):
    lengths = np.array([0.0, 1e-4, 0.3, 0.99, 1.01, 4.0, 50.0], np.float32)
    offsets = lengths[:, None] * np.array([0.6, 0.0, 0.8], np.float32)[None, :]
    x = lengths.astype(np.float64) ** 2
    expected = {
        "geman_mcclure": x / (1 + x),
        "cauchy": np.log1p(x),
        "huber": np.where(x < 1, x, 2 * np.sqrt(x) - 1),
        "squared": x,
    }[loss]
    found = np.sum(np.asarray(robustify(offsets, loss), np.float64) ** 2, axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-9)
    slope = jax.jacfwd(lambda v: robustify(v, loss))(jnp.zeros((1, 3), jnp.float32))
    np.testing.assert_allclose(slope[0, :, 0], np.eye(3), atol=1e-6)
    by_slope = {
        "geman_mcclure": 1 / (1 + x) ** 2,
        "cauchy": 1 / (1 + x),
        "huber": np.where(x < 1, 1, 1 / np.sqrt(np.maximum(x, 1))),
        "squared": np.ones_like(x),
    }[loss]
    np.testing.assert_allclose(robust_slope(jnp.asarray(x, jnp.float32), loss), by_slope, rtol=1e-5)
