"""What only a GPU can show: compiled kernels give what oracles say, and `register` decides there as on a CPU.

`bench/on_gpu.sh` runs this file and, on the same device, the oracle tests of every kernel in `tests/ops`.
"""

import json
import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles import sliding_window
from small_worlds import OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax.maps.prepared import prepare_map
from voxjax.ops import box_count, window_classes
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.solve.pose import solve_pose

pytestmark = pytest.mark.gpu

POSE = pose(yaw=33.0, translation=(3.0, -2.0, 1.0))


def pairs() -> dict[str, tuple[vx.VoxelGrid, vx.VoxelGrid]]:
    """One pair of one building, and one of two different ones."""
    a = draw_map()
    return {
        "same": (a, draw_map(POSE)),
        "different": (a, draw_map(POSE, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)),
    }


def verdicts() -> dict[str, tuple[str, list]]:
    """Verdict and pose of each pair on the default device."""
    found = {name: vx.register(*pair) for name, pair in pairs().items()}
    return {name: (one.verdict, np.asarray(one.T_a_b).tolist()) for name, one in found.items()}


@pytest.mark.filterwarnings("ignore:The Pallas Triton backend is deprecated:DeprecationWarning")
@pytest.mark.parametrize("implementation", ["separable", "packed", "summed_area", "pallas"])
def test_counts_are_those_of_the_loop(implementation: str) -> None:
    grid = np.random.default_rng(0).random((19, 14, 37)) < 0.3
    counts = np.asarray(box_count(grid, size=5, implementation=implementation))
    np.testing.assert_array_equal(counts, sliding_window.window_count(grid, 5))


@pytest.mark.filterwarnings("ignore:The Pallas Triton backend is deprecated:DeprecationWarning")
@pytest.mark.parametrize("implementation", ["passes", "pallas"])
def test_classes_are_those_of_the_loop(implementation: str) -> None:
    grid = np.random.default_rng(1).random((9, 10, 15)) < 0.2
    found = window_classes(grid, np.int32(40), size=5, shift=2, implementation=implementation)
    np.testing.assert_array_equal(np.asarray(found), sliding_window.classes(grid, 5, 2, 40))


def test_register_decides_as_on_a_cpu() -> None:
    command = "import json, test_on_gpu; print(json.dumps(test_on_gpu.verdicts()))"
    here = os.path.dirname(__file__)
    path = os.pathsep.join([here, os.path.dirname(here), *sys.path])
    settings = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", command], env=settings, capture_output=True, check=True)
    on_cpu = json.loads(done.stdout.splitlines()[-1])
    for name, (verdict, T_a_b) in verdicts().items():
        assert verdict == on_cpu[name][0]
        if verdict == "accepted":
            np.testing.assert_allclose(T_a_b, on_cpu[name][1], atol=2e-3)


def test_a_gradient_of_the_refinement_is_finite_and_not_zero() -> None:
    a, b = pairs()["same"]
    floats, others = eqx.partition(pose_problem(prepare_map(a), prepare_map(b)), eqx.is_inexact_array)
    start, scales = jnp.asarray(np.linalg.inv(POSE), jnp.float32), jnp.asarray([0.3, 0.15], jnp.float32)

    @jax.jit
    def moved(floats):
        return jnp.sum(solve_pose(eqx.combine(floats, others), start, scales).T_a_b, dtype=jnp.float32)

    gradients = [np.asarray(g) for g in jax.tree.leaves(jax.grad(moved)(floats))]
    assert all(np.isfinite(g).all() for g in gradients)
    assert any(np.abs(g).max(initial=0.0) > 0 for g in gradients)
