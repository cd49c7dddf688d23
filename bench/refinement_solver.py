"""The solver by itself: warm times at 10,240 points, gradients, many starts, and what a new process compiles.

`python -m bench.refinement_solver SEED CACHE` is what the part runs in processes of their own: it prints the
seconds of the first solve in a process, with its kernels compiled or found in the cache folder.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from bench.refinement_cases import generated_cases, starts_of
from bench.refinement_parts import Plan, Row
from bench.timing import time_interleaved
from voxjax import use_compilation_cache
from voxjax._runtime.compilation_cache import PROGRAMS
from voxjax._runtime.programs import keep_programs
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.problems.coarse_to_fine import robust_scales
from voxjax.refinement.problems.many_starts import solve_starts
from voxjax.refinement.problems.pair import as_dtype, pose_problem
from voxjax.refinement.solve.pose import RefinedPose, solve_pose
from voxjax.refinement.solve.problem import PoseProblem

TARGETS = {
    "float32, warm": ("seconds", 0.030),
    "float64, warm": ("seconds", 0.015),
    "gradient, float32": ("times one solve", 3.0),
    "gradient, float64": ("times one solve", 3.0),
    "64 starts": ("times one solve", 10.0),
    "first solve, compiled": ("seconds", 3.0),
    "first solve, from the cache": ("seconds", 0.6),
}
"""Targets by row: the unit of the row's value, and the most that it may be."""


def solver_rows(plan: Plan, refiners: object) -> Iterator[Row]:
    """A row for each time, with its target."""
    del refiners
    starts, problem, scales = make_problem(plan.seed, 64)
    for name, dtype in (("float32", np.float32), ("float64", np.float64)):
        with jax.enable_x64(dtype == np.float64):
            typed, levels = as_dtype(problem, dtype), scales.astype(dtype)
            times = _times(typed, jnp.asarray(starts, dtype), levels)
        one = times["solve"]
        yield _row(f"{name}, warm", one)
        yield _row(f"gradient, {name}", times["gradient"] / one)
        if dtype == np.float32:
            yield _row("64 starts", times["starts"] / one)
            yield _row("64 starts under vmap", times["vmap"] / one)
    with tempfile.TemporaryDirectory() as cache:
        yield _row("first solve, compiled", _in_process(plan.seed, cache))
        yield _row("first solve, from the cache", _in_process(plan.seed, cache))


def make_problem(
    seed: int, num_starts: int, *, num_points: int = 10240
) -> tuple[np.ndarray, PoseProblem, np.ndarray]:
    """Starts, point-to-plane residuals of a generated pair one way, and the scales that `vx.refine` takes."""
    case = generated_cases("drift-free", 1, seed)[0]
    pair = case.load()
    problem = pose_problem(prepare_map(pair.a), prepare_map(pair.b), num_points=num_points)
    starts = starts_of(case, pair, num_starts, seed=seed)
    voxel = pair.a.voxel_size
    return np.stack(starts).astype(np.float32), problem, robust_scales(4 * voxel, voxel)


def _times(problem: PoseProblem, poses: jax.Array, scales: np.ndarray) -> dict[str, float]:
    """Medians of a solve, of a solve with its gradient, and of all starts at once in two ways [s]."""
    batched = eqx.filter_jit(jax.vmap(lambda T: solve_pose(problem, T, scales)))
    candidates: dict[str, Callable[[], object]] = {
        "solve": _solve(problem, poses, scales),
        "gradient": _gradient(problem, poses, scales),
        "starts": lambda: solve_starts(problem, poses, scales),
    }
    times = time_interleaved(candidates, rounds=21) + time_interleaved(
        {"vmap": lambda: batched(poses)}, rounds=3
    )
    return {timing.name: timing.median_s for timing in times}


def _solve(problem: PoseProblem, poses: jax.Array, scales: np.ndarray) -> Callable[[], RefinedPose]:
    turn = iter(range(1 << 30))
    return lambda: solve_pose(problem, poses[next(turn) % len(poses)], scales)


def _gradient(problem: PoseProblem, poses: jax.Array, scales: np.ndarray) -> Callable[[], Any]:
    """A sum over the refined pose and its derivative with respect to the weights of all points."""
    turn = iter(range(1 << 30))

    def probe(weights: jax.Array, problem: PoseProblem, T: jax.Array) -> jax.Array:
        changed = eqx.tree_at(lambda p: p.terms[0].sample.weights, problem, weights)
        return jnp.sum(solve_pose(changed, T, scales).T_a_b[:3, 3], dtype=T.dtype)

    slope = eqx.filter_jit(jax.value_and_grad(probe))
    weights = jnp.asarray(problem.terms[0].sample.weights)  # pyright: ignore[reportAttributeAccessIssue]
    return lambda: slope(weights, problem, poses[next(turn) % len(poses)])


def _row(name: str, value: float) -> Row:
    unit, most = TARGETS.get(name, ("times one solve", None))
    return {"solver": name, "value": value, "unit": unit, "most": most}


def _in_process(seed: int, cache: str) -> float:
    """Seconds of the first solve in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "bench.refinement_solver", str(seed), cache],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)["seconds"]


def _first_solve(seed: int, cache: str) -> float:
    """Seconds until the solution, where programs and kernels are looked for in a folder from then on only."""
    folder = use_compilation_cache(cache) / PROGRAMS
    keep_programs(None)
    starts, problem, scales = make_problem(seed, 1)
    T = jnp.asarray(starts[0])
    jax.block_until_ready(jnp.sum(T, dtype=jnp.float32))  # the device is ready
    start = time.perf_counter()
    keep_programs(folder)
    jax.block_until_ready(solve_pose(problem, T, scales))
    return time.perf_counter() - start


if __name__ == "__main__":
    print(json.dumps({"seconds": _first_solve(int(sys.argv[1]), sys.argv[2])}))
