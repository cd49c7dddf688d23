"""Processes that are forked after kernels ran say so instead of hanging; others are not affected."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

START = """
import os, sys, jax, numpy as np, voxjax as vx
from voxjax._runtime.programs import kept_program

double = kept_program(jax.jit(lambda x: 2 * x))

def run():
    return float(double(np.float32(3)))

def child(function):
    number = os.fork()
    if number == 0:
        try:
            print(function(), flush=True)
        except RuntimeError as error:
            print(error, flush=True)
        os._exit(0)
    os.waitpid(number, 0)
"""


def _lines(code):
    """What a process prints; it is ended if it hangs."""
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", START + code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
    )
    return done.stdout.splitlines()


def test_a_fork_after_a_kernel_is_told_to_spawn_and_the_parent_goes_on():
    code = """
print(run(), flush=True)
child(run)
child(lambda: vx.register(None, None))
child(lambda: os.execv(sys.executable, [sys.executable, "-c", "print('another program')"]))
print(run())
"""
    first, by_kernel, by_register, other, last = _lines(code)
    assert (first, other, last) == ("6.0", "another program", "6.0")
    assert by_kernel == by_register
    assert "multiprocessing.get_context('spawn')" in by_kernel


def test_a_fork_before_any_kernel_computes():
    assert _lines("child(run)\nprint(run())") == ["6.0", "6.0"]
