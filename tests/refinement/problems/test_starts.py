"""Starts of a refinement: what is refused, and what stays as it is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles.motions import random_pose
from voxjax import InputError
from voxjax.refinement.problems.starts import checked_start, checked_starts, lead_pose, values_of_start

POSES = [random_pose(np.random.default_rng(seed)) for seed in range(3)]


def test_one_start_and_several_are_taken():
    np.testing.assert_allclose(checked_start("T", POSES[0]), POSES[0], atol=1e-6)
    np.testing.assert_allclose(checked_start("T", np.stack(POSES)), np.stack(POSES), atol=1e-6)
    np.testing.assert_allclose(checked_starts("T", POSES), np.stack(POSES), atol=1e-6)


def test_what_is_no_start_is_named():
    with pytest.raises(InputError, match="T must hold at least one start"):
        checked_start("T", np.zeros((0, 4, 4)))
    with pytest.raises(InputError, match=r"T\[1\]"):
        checked_start("T", np.stack([POSES[0], 2.0 * POSES[1]]))


def test_traced_starts_pass_but_have_values_only_under_grad():
    def taken(T):
        return jnp.sum(checked_start("T", T) * 2.0, dtype=T.dtype)

    T = jnp.asarray(POSES[0], jnp.float32)
    np.testing.assert_array_equal(jax.grad(taken)(T), np.full((4, 4), 2.0))
    jax.grad(lambda T: jnp.sum(T * np.asarray(values_of_start("T", T)), dtype=T.dtype))(T)
    with pytest.raises(InputError, match="T must be values, not traced by jit"):
        jax.jit(lambda T: values_of_start("T", T))(T)


def test_without_coarser_maps_a_start_stays():
    T = np.asarray(POSES[0], np.float32)
    np.testing.assert_array_equal(lead_pose(T, np.zeros(3), (), loss="geman_mcclure", both_ways=False), T)
