"""Processes that are forked after JAX began say so instead of hanging; others are not affected."""

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


def test_a_fork_after_jax_began_is_refused_by_whatever_runs_kernels():
    code = """
import inspect, voxjax.ops, voxjax.rigid
from voxjax.ops.resampling.raycast import crossed_voxels
from voxjax.ops.resampling.rigid import resample_rigid

def functions(module):
    members = {name: getattr(module, name) for name in module.__all__}
    return {name: value for name, value in members.items() if callable(value) and not inspect.isclass(value)}

on_host = {"read_map", "write_map", "use_compilation_cache", "near_tiles", "point_tree"}
verbs = functions(vx) | functions(vx.ops)
verbs |= {"crossed_voxels": crossed_voxels, "resample_rigid": resample_rigid}
verbs |= {name: getattr(vx.rigid, name) for name in ("apply", "adjoint", "exp", "exp_so3", "hat", "log", "log_so3")}
box = np.ones((9, 9, 9), bool)

def refused():
    said = set()
    for name in verbs.keys() - on_host:
        try:
            verbs[name]()
            said.add(name)
        except RuntimeError as error:
            said.add(str(error))
        except TypeError:  # it has begun
            said.add(name)
    return "; ".join(said)

jax.devices()
child(refused)
child(lambda: vx.box_count(box))
grid = vx.VoxelGrid(2 * box.astype(np.uint8), np.zeros(3, np.float32), 0.5)
child(lambda: vx.fuse([grid], [np.eye(4)]))
child(lambda: vx.VoxelGrid(grid.states, grid.origin, 0.5).num_occupied)
print(int(vx.box_count(box)[4, 4, 4]))
"""
    by_all, by_box, by_fuse, on_host, of_parent = _lines(code)
    assert by_all == by_box == by_fuse
    assert "forked after JAX had begun" in by_all
    assert (on_host, of_parent) == ("729", "343")


def test_a_fork_before_any_kernel_computes():
    assert _lines("child(run)\nprint(run())") == ["6.0", "6.0"]
