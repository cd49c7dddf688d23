"""The arrays of a grid: what they become, and what is refused on host and device alike."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import InputError
from voxjax._grid_arrays import as_float32, as_states, check_log_odds, check_origin, check_states


@pytest.mark.parametrize("put", [np.asarray, jnp.asarray], ids=["host", "device"])
def test_values_are_checked_wherever_they_lie(put):
    states = put(np.asarray([[[0, 1, 2]]], np.uint8))
    assert as_states(states) is states
    check_states(states)
    with pytest.raises(InputError, match="got 7"):
        check_states(put(np.asarray([[[0, 7]]], np.uint8)))
    with pytest.raises(InputError, match="uint8"):
        as_states(put(np.zeros((1, 1, 1), np.int32)))
    check_log_odds(put(np.full((2, 2, 2), 3e38, np.float32)))  # their sum overflows, they do not
    with pytest.raises(InputError, match="finite"):
        check_log_odds(put(np.asarray([[[0.0, np.nan]]], np.float32)))
    check_origin(put(np.zeros(3, np.float32)), (3, 3, 3), 0.1)
    with pytest.raises(InputError, match="origin"):
        check_origin(put(np.asarray([0.0, np.inf, 0.0], np.float32)), (3, 3, 3), 0.1)
    with pytest.raises(InputError, match="reach beyond"):
        check_origin(put(np.zeros(3, np.float32)), (3, 3, 10**9), 1e9)


def test_numbers_become_float32_but_wider_ones_on_a_device_stay():
    assert as_float32("origin", [1, 2, 3]).dtype == np.float32
    with jax.enable_x64(True):
        assert as_float32("log_odds", jnp.zeros(3, jnp.float64)).dtype == np.float64
    with pytest.raises(InputError, match="origin must be an array of numbers"):
        as_float32("origin", ["a", "b"])


def test_what_is_traced_is_asked_for_its_dtype_alone():
    def counted(log_odds):
        check_log_odds(log_odds)
        return jnp.sum(as_float32("log_odds", log_odds), dtype=jnp.float32)

    assert float(jax.jit(counted)(np.ones(3, np.float32))) == 3.0
