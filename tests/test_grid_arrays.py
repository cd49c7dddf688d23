"""The arrays of a grid: what they become, and what is refused on host and device alike."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import InputError
from voxjax._grid_arrays import (
    as_float32,
    as_place,
    as_states,
    check_log_odds,
    check_origin,
    check_shapes,
    check_states,
    grid_text,
)


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


def test_places_are_three_numbers_of_float64_on_the_host():
    place = as_place("shift", jnp.asarray([1.0, 2.0, 3.0]))
    assert isinstance(place, np.ndarray)
    assert place.dtype == np.float64
    for value, words in (
        ([1, 2], r"shift must have shape \(3,\), got \(2,\)"),
        (["a", "b", "c"], "shift must be an array of numbers"),
    ):
        with pytest.raises(InputError, match=words):
            as_place("shift", value)


def test_fields_of_a_grid_fit_together():
    check_shapes((1, 2, 3), np.zeros(3), (1, 2, 3))
    check_shapes((1, 2, 3), np.zeros(3), None)
    for arguments, words in (
        (((1, 2), np.zeros(3), None), "states must have three axes"),
        (((1, 2, 3), np.zeros(2), None), r"origin must have shape \(3,\)"),
        (((1, 2, 3), np.zeros(3), (3, 2, 1)), r"shape of states \(1, 2, 3\), got \(3, 2, 1\)"),
    ):
        with pytest.raises(InputError, match=words):
            check_shapes(*arguments)


def test_the_text_of_a_grid_names_counts_where_there_are_some():
    extent = np.zeros(3), np.array([0.2, 0.1, 0.1])
    box = "2 x 1 x 1 voxels of 0.1 m, x 0.00..0.20 y 0.00..0.10 z 0.00..0.10 m"
    assert grid_text((2, 1, 1), 0.1, extent, None) == f"{box}, not counted yet"
    assert grid_text((2, 1, 1), 0.1, extent, {"free": 1}) == f"{box}, 1 free (50.0 %)"
