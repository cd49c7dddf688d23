"""The implicit derivative: of any order, with failures as data, and kept by JAX's cache for the next process."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax.refinement.solve.implicit import by_conjugate_gradients, by_pseudo_inverse, implicit_solution

KERNELS = """
import jax, jax.numpy as jnp, numpy as np
from voxjax.refinement.residuals.known import CornerPairs
from voxjax.refinement.solve.joint import solve_joint
from voxjax.refinement.solve.joint_problem import JointProblem, edges_of
from voxjax.refinement.solve.noise import implicit_covariance
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem

events = []
jax.monitoring.register_event_listener(lambda name, **_: events.append(name.rsplit("/", 1)[1]))
rng = np.random.default_rng(0)
of_b = rng.uniform(-2, 2, (12, 3)).astype(np.float32)
of_a = of_b + rng.normal(size=(12, 3)).astype(np.float32) / 50
start, scales = np.eye(4, dtype=np.float32), np.ones(1, np.float32)

def problem(share):
    pairs = CornerPairs(of_a=of_a, of_b=of_b, share=share, loss="squared")
    return PoseProblem((pairs,), of_b.mean(axis=0), np.float32(1.0))

def pose(share):
    return solve_pose(problem(share), start, scales).T_a_b

def poses(share):
    edges = edges_of([(k, k + 1, problem(share)) for k in range(9 - 1)])
    centroids, radii = np.zeros((9, 3), np.float32), np.ones(9, np.float32)
    joint = JointProblem(edges, centroids, radii, np.arange(9) == 0)
    return solve_joint(joint, np.tile(start, (9, 1, 1)), scales).poses

share = jnp.full(12, 1 / 12, jnp.float32)
found = [
    jax.jit(jax.jacrev(pose))(share),
    # So many maps that the derivative is found by conjugate gradients.
    jax.jit(jax.grad(lambda share: poses(share)[1, 0, 3]))(share),
    implicit_covariance(problem(share), start, scales[0], deviation=np.float32(0.01),
                        patch=np.float32(0.5), prior=np.ones(6, np.float32)),
]
print(all(np.isfinite(each).all() and np.abs(each).max() > 0 for each in found))
print(events.count("cache_hits") > 0, events.count("cache_misses"))
print(events.count("compile_requests_use_cache") - events.count("cache_hits"))
"""


def _second_process(code, folder):
    """What the second of two processes with one cache prints, and the files that each of them left."""
    environment = {
        **{name: os.environ[name] for name in ("PYTHONPATH",) if name in os.environ},
        "PATH": os.environ["PATH"],
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": str(folder),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    files = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
        )
        files.append({path.name for path in folder.glob("*-cache")})
    return done.stdout.splitlines(), *files


def test_a_second_process_compiles_no_derivative(tmp_path):
    shown, first, second = _second_process(KERNELS, tmp_path)
    assert shown == ["True", "True 0", "0"]
    assert first == second


def _line(unknowns, inputs):
    """Slope of a quadratic cost whose solution is inputs / stiffness; no stiffness fixes nothing."""
    target, stiffness = inputs
    return stiffness * unknowns - target


def _solution(target, stiffness, solve):
    at = jnp.where(stiffness == 0, 0.0, target / jnp.where(stiffness == 0, 1.0, stiffness))
    return implicit_solution(
        jax.lax.stop_gradient(at),
        (target, stiffness),
        slope=_line,
        solve=solve,
    )


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_first_and_second_derivatives_are_those_of_the_closed_form(mode):
    target, stiffness = jnp.asarray([1.0, -2.0]), jnp.asarray([4.0, 0.5])
    solve = by_pseudo_inverse(1e-5)
    found = mode(lambda s: _solution(target, s, solve))(stiffness)
    np.testing.assert_allclose(found, jnp.diag(-target / stiffness**2), rtol=1e-6)
    second = mode(mode(lambda s: _solution(target, s, solve)[1]))(stiffness)
    np.testing.assert_allclose(second[1, 1], 2 * target[1] / stiffness[1] ** 3, rtol=1e-6)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_what_nothing_fixes_has_no_derivative_and_a_failed_solve_is_nan(mode):
    target = jnp.asarray([1.0, -2.0])
    of = lambda stiffness, solve: mode(lambda t: _solution(t, jnp.asarray(stiffness), solve))(target)
    np.testing.assert_array_equal(of([2.0, 0.0], by_pseudo_inverse(1e-5)), [[0.5, 0.0], [0.0, 0.0]])
    assert np.isnan(of([2.0, np.nan], by_pseudo_inverse(1e-5))).any()
    # Conjugate gradients cannot know what nothing fixes, so a right side along it is a failure.
    assert np.isnan(of([2.0, 0.0], by_conjugate_gradients(1e-5))[1, 1])
    np.testing.assert_allclose(of([2.0, 4.0], by_conjugate_gradients(1e-5)), [[0.5, 0.0], [0.0, 0.25]])
