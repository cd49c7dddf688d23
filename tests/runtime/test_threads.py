"""Work that is spread over the cores."""

import os
import signal
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax._runtime import threads as _threads
from voxjax._runtime.threads import spread


@pytest.fixture(params=[1, 3], autouse=True)
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(_threads, "num_cores", lambda: request.param)
    return request.param


def test_results_keep_the_order_of_the_items() -> None:
    def slow_at_first(item: int) -> int:
        time.sleep(0.01 if item == 0 else 0.0)
        return item * item

    assert spread(slow_at_first, iter(range(20))) == [item * item for item in range(20)]
    assert spread(slow_at_first, []) == []


def test_all_cores_work(cores: int) -> None:
    together = threading.Barrier(cores, timeout=10)

    def meet(_: int) -> int:
        together.wait()
        return threading.get_ident()

    assert len(set(spread(meet, range(cores)))) == cores


def test_the_first_error_in_the_order_of_the_items_is_raised() -> None:
    def fail_twice(item: int) -> None:
        if item in (2, 5):
            time.sleep(0.02 if item == 2 else 0.0)
            raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item 2"):
        spread(fail_twice, range(8))


def test_pieces_of_a_piece_stay_in_its_thread() -> None:
    def inner(_: int) -> int:
        return threading.get_ident()

    def outer(_: int) -> bool:
        return set(spread(inner, range(4))) == {threading.get_ident()}

    assert all(spread(outer, range(6)))


def test_no_piece_is_part_of_the_trace_of_the_caller() -> None:
    @jax.jit
    def scaled(scale: jax.Array) -> jax.Array:
        return scale * np.stack(spread(lambda item: np.asarray(jnp.cos(np.float32(item))), range(6)))

    np.testing.assert_allclose(scaled(jnp.float32(2)), 2 * np.cos(np.arange(6, dtype=np.float32)), rtol=1e-6)


def test_all_pieces_have_one_precision_whatever_the_caller_has_set() -> None:
    with jax.enable_x64(True):
        dtypes = spread(lambda item: jnp.asarray(float(item)).dtype, range(6))
    assert set(dtypes) == {np.dtype(np.float32)}


def test_the_threads_stay(cores: int) -> None:
    together = threading.Barrier(cores, timeout=10)

    def meet(_: int) -> int:
        together.wait()
        return threading.get_ident()

    assert set(spread(meet, range(cores))) == set(spread(meet, range(cores)))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore::RuntimeWarning", "ignore::DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    assert spread(abs, [-1, -2]) == [1, 2]
    child = os.fork()
    if child == 0:
        os._exit(0 if spread(abs, [-3]) == [3] else 1)
    for _ in range(1000):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        time.sleep(0.01)
    else:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        pytest.fail("the forked process waits for threads that it does not have")
    assert os.waitstatus_to_exitcode(status) == 0
