"""Parts of the benchmark of refinement: each takes the plan and the methods, and gives rows of plain data."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.refinement_cases import RefinementCase, generated_cases, sim_cases, starts_of
from bench.refinement_peers import Refiner
from bench.timing import turned
from bench.worlds import MapPair
from voxjax.metrics import PoseError, pose_error

Row = dict[str, Any]

LINES = {"translation": (2.0, 0.0), "rotation": (0.0, 30.0), "both": (2.0, 30.0)}
"""Lines of starts of the part "basin", by name, with the largest error (metres, degrees) of each."""


@dataclass(frozen=True)
class Plan:
    """The pairs, starts and errors that are run.

    Attributes:
        suites: Pairs of the part "accuracy".
        basin: Pairs of the part "basin".
        starts: Random starts of each pair and error.
        levels: Errors of a line of the part "basin", zero included.
        seed: Seed of the starts.
    """

    suites: Sequence[RefinementCase]
    basin: Sequence[RefinementCase]
    starts: int
    levels: int
    seed: int


def full_plan(maps: Path | None, seed: int, *, pairs: int | None = None, starts: int | None = None) -> Plan:
    """All pairs of the folder "sim" of the maps, and generated pairs; the basin on a third of those without drift."""
    count = pairs or 12
    free, drifting = (generated_cases(suite, count, seed) for suite in ("drift-free", "drifting"))
    sim = sim_cases(maps) if maps is not None else []
    return Plan([*sim, *free, *drifting], free[:: max(count // 4, 1)][:4], starts or 3, 9, seed)


def quick_plan(maps: Path | None, seed: int, *, pairs: int | None = None, starts: int | None = None) -> Plan:
    """One pair of the folder "sim", and generated pairs of large voxels, one unless told."""
    free = generated_cases("drift-free", 3 * (pairs or 1), seed)[2::3]
    sim = sim_cases(maps)[:1] if maps is not None else []
    return Plan([*sim, *free], free[:1], starts or 1, 3, seed)


def accuracy_rows(plan: Plan, refiners: Sequence[Refiner]) -> Iterator[Row]:
    """A row for each suite and method: errors after refinement, share converged, times."""
    found: dict[tuple[str, str], list[Row]] = {}
    for turn, case in enumerate(plan.suites):
        print(f"  {case.name}", flush=True)
        pair = case.load()
        starts = starts_of(case, pair, plan.starts, seed=plan.seed)
        for refiner in turned(refiners, turn):
            begin = time.perf_counter()
            refine = refiner.prepare_near(pair)
            prepare_seconds = time.perf_counter() - begin
            refine(starts[0])  # compiles, warms
            for start in starts:
                begin = time.perf_counter()
                T = refine(start)
                seconds = time.perf_counter() - begin
                error = _error(T, pair)
                found.setdefault((case.suite, refiner.name), []).append(
                    {
                        "case": case.name,
                        "metres": error.metres,
                        "voxels": error.metres / pair.a.voxel_size,
                        "degrees": error.degrees,
                        "converged": has_converged(error, pair.a.voxel_size),
                        "seconds": seconds,
                        "prepare_seconds": prepare_seconds,
                    }
                )
    suites = dict.fromkeys(case.suite for case in plan.suites)
    for suite in suites:
        for refiner in refiners:
            yield accuracy_row(suite, refiner.name, found[suite, refiner.name])


def accuracy_row(suite: str, method: str, poses: Sequence[Row]) -> Row:
    """Medians and 90th percentiles of one method's poses on one suite."""
    spread = {
        key: [float(q) for q in np.percentile([p[key] for p in poses], (50, 90))]
        for key in ("metres", "voxels", "degrees", "seconds", "prepare_seconds")
    }
    return {
        "suite": suite,
        "method": method,
        "num_pairs": len({p["case"] for p in poses}),
        "num_poses": len(poses),
        "converged": sum(p["converged"] for p in poses) / len(poses),
        **spread,
    }


def basin_rows(plan: Plan, refiners: Sequence[Refiner]) -> Iterator[Row]:
    """A row for each line of starts and method: errors of the starts and the share that converged from each."""
    share = np.linspace(0.0, 1.0, plan.levels)
    hits: dict[tuple[str, str], np.ndarray] = {}
    for turn, case in enumerate(plan.basin):
        print(f"  {case.name}", flush=True)
        pair = case.load()
        for refiner in turned(refiners, turn):
            refine = refiner.prepare_wide(pair)
            for line, (most_metres, most_degrees) in LINES.items():
                count = hits.setdefault((line, refiner.name), np.zeros(plan.levels, np.int64))
                for level, far in enumerate(share):
                    size = {"metres": far * most_metres, "degrees": far * most_degrees}
                    starts = starts_of(case, pair, plan.starts, **size, seed=plan.seed)
                    for start in starts[:1] if far == 0.0 else starts:
                        count[level] += has_converged(_error(refine(start), pair), pair.a.voxel_size)
    trials = np.full(plan.levels, len(plan.basin) * plan.starts)
    trials[0] = len(plan.basin)  # without an error all directions are one
    for line, (most_metres, most_degrees) in LINES.items():
        for refiner in refiners:
            yield {
                "line": line,
                "method": refiner.name,
                "num_pairs": len(plan.basin),
                "num_trials": trials.tolist(),
                "metres": (share * most_metres).tolist(),
                "degrees": (share * most_degrees).tolist(),
                "converged": (hits[line, refiner.name] / trials).tolist(),
            }


def has_converged(error: PoseError, voxel_size: float) -> bool:
    """Return whether a pose is within 1 degree and the larger of 0.15 m and a voxel of the truth."""
    return error.degrees <= 1.0 and error.metres <= max(0.15, voxel_size)


def _error(T: np.ndarray, pair: MapPair) -> PoseError:
    assert pair.T_a_b is not None  # starts_of has refused other pairs
    return pose_error(T, pair.T_a_b, pair.centroid_of_b)
