"""Calls taken apart: arrays are put back where they were, and keys tell programs apart but not values."""

import math

import jax
import numpy as np

from voxjax._runtime.calls import Call

ONES = np.ones(3, np.float32)


def test_arrays_go_back_to_their_places():
    call = Call.of((ONES, {"b": 2}), {"c": (np.zeros(2, np.int32), "name")})
    assert [array.shape for array in call.arrays] == [(3,), (2,)]
    args, kwargs = call.with_arrays(["first", "second"])
    assert args == ("first", {"b": 2})
    assert kwargs == {"c": ("second", "name")}


def test_keys_depend_on_shapes_and_settings_and_not_on_values():
    key = Call.of((ONES,), {"n": 2}).key()
    assert key == Call.of((2 * ONES,), {"n": 2}).key()
    assert key != Call.of((ONES,), {"n": 3}).key()
    # They become constants of the program, which tells them apart though they are equal.
    assert Call.of((ONES,), {"n": 0.0}).key() != Call.of((ONES,), {"n": -0.0}).key()
    assert Call.of((ONES,), {"n": math.nan}).key() == Call.of((ONES,), {"n": math.nan}).key()
    assert key != Call.of((np.ones(4, np.float32),), {"n": 2}).key()
    with jax.enable_x64(True):
        assert key != Call.of((ONES,), {"n": 2}).key()
    assert Call.of((object(),), {}).key() is None
