import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax._runtime import placement
from voxjax._runtime.placement import are_numpy, on_host, to_device


def test_values_on_a_cpu_are_on_the_host_and_traced_ones_are_not() -> None:
    seen = []

    @jax.jit
    def look(x: jax.Array) -> jax.Array:
        seen.append(on_host({"x": x, "y": np.zeros(2)}))
        return x

    look(jnp.zeros(3))
    assert seen == [False]
    assert on_host(jnp.zeros(3), np.zeros(2), 1.0) == (jax.default_backend() == "cpu")


def test_another_backend_has_no_host_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(placement, "backend", lambda: "gpu")
    assert not on_host()
    assert not on_host(np.zeros(2))


def test_only_numpy_arrays_are_numpy() -> None:
    assert are_numpy((np.zeros(1), [np.zeros(2)]))
    assert not are_numpy(np.zeros(1), jnp.zeros(1))
    assert not are_numpy(np.zeros(1), 1.0)


def test_values_go_to_the_device_with_their_dtypes() -> None:
    flag, scales = to_device((np.bool_(True), np.asarray([1, 2], np.float32)))
    assert isinstance(flag, jax.Array)
    assert flag.dtype == np.bool_
    assert scales.dtype == np.float32
