"""Does the confidence mean what it says? Verdicts on generated pairs of one building, equal rooms, other buildings.

    python -m bench calibration [--pairs 200] [--hotels 60] [--buildings 25] [--seed 300000] [--cache FOLDER]
    python -m bench calibration --families 8 [--seed 300000]

Different buildings: each map against each other one. The seed is another one than that of the worlds that the model of
the verdict was fitted on (100000, `python -m bench verdict_fit`). Prints the verdicts by kind, the false accepts with
the upper 95 % bound of their rate (Clopper-Pearson), the expected calibration error in ten bins, and how the errors of
accepted poses compare with their covariance; writes JSON and a reliability diagram. `--cache` keeps the generated maps;
several processes can share the work by `--part 1/2` and be put together by `--join`. `--clouds` takes all free space
from the maps. `--families` takes pairs of all families of places instead (`bench/family_rows.py`).
"""

import argparse
import itertools
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.calibration_worlds import load_world, seeds_of, without_free_space
from bench.family_rows import family_jobs, family_row, family_table
from bench.reliability import draw, summary
from bench.reports import write_json
from bench.timing import setting
from voxjax.metrics import pose_error
from voxjax.pipeline.config import Config
from voxjax.pipeline.features import features_at, working_voxel
from voxjax.pipeline.pair import register_features


def judge(found: vx.Registration, truth: np.ndarray | None, b: vx.VoxelGrid) -> dict[str, Any]:
    """One row: the verdict, the evidence that it rests on, and the truth within 3 degrees and 0.4 m."""
    row: dict[str, Any] = {
        "verdict": found.verdict,
        "confidence": found.confidence,
        "right": False,
        "rank": None,
        "rounds": found.stats.get("num_rounds"),
        "proposed": found.stats.get("num_hypotheses"),
        "has_free_space": found.stats.get("has_free_space"),
        "seconds": sum(found.stats["seconds"].values()),
    }
    centroid = b.occupied_points().mean(axis=0, dtype=np.float64)
    errors = [None if truth is None else pose_error(h.T_a_b, truth, centroid) for h in found.hypotheses]
    good = [e is not None and e.degrees <= 3.0 and e.metres <= 0.4 for e in errors]
    row["leaders"] = [
        {
            "score": h.evidence.score,
            "support": h.evidence.support,
            "shared": h.evidence.shared_area,
            "contradiction": h.evidence.contradiction_area,
            "conflict": h.evidence.free_conflict,
            "right": is_right,
        }
        for h, is_right in zip(found.hypotheses, good, strict=True)
    ]
    row["rank"] = good.index(True) if True in good else None
    row["right"] = row["rank"] == 0
    if row["right"] and errors[0] is not None and truth is not None:
        T = np.asarray(found.T_a_b, np.float64)
        # In the order of the covariance: translation of map b's centroid, then rotation, both in frame a.
        turn = Rotation.from_matrix(truth[:3, :3] @ T[:3, :3].T).as_rotvec()
        shift = (truth - T)[:3] @ np.append(centroid, 1.0)
        row |= {"tangent": [*shift, *turn], "covariance": np.asarray(found.covariance).tolist()}
        row |= {"degrees": errors[0].degrees, "metres": errors[0].metres}
    return row


class Runner:
    """Loads and registers pairs; keeps the features of the buildings' single maps."""

    def __init__(self, cache: Path | None, *, clouds: bool) -> None:
        self.cache = cache
        self.clouds = clouds
        self.single: dict[int, Any] = {}

    def load(self, seed: int, kind: str) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
        """Maps and true pose of a seed."""
        grids, truth = load_world(seed, kind, self.cache)
        return [without_free_space(g) for g in grids] if self.clouds else grids, truth

    def row(self, kind: str, seeds: tuple[int, ...]) -> dict[str, Any]:
        """Register one pair."""
        return {"kind": kind} | self._judged(kind, seeds)

    def _judged(self, kind: str, seeds: tuple[int, ...]) -> dict[str, Any]:
        if kind == "cross":
            for seed in seeds:
                if seed not in self.single:
                    (grid,), _ = self.load(seed, "build")
                    self.single[seed] = grid, features_at(grid, voxel_size=grid.voxel_size)
            (_, fa), (b, fb) = (self.single[seed] for seed in seeds)
            return judge(register_features(fa, fb), None, b)
        (a, b), truth = self.load(seeds[0], kind)
        size = working_voxel([a, b], Config()).size
        fa, fb = features_at(a, voxel_size=size), features_at(b, voxel_size=size)
        return judge(register_features(fa, fb), truth, b)


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench calibration", description=__doc__)
    parser.add_argument("--pairs", type=int, default=200, help="pairs of one building")
    parser.add_argument("--hotels", type=int, default=60, help="pairs among equal rooms")
    parser.add_argument(
        "--buildings", type=int, default=25, help="maps of different buildings, each against each"
    )
    parser.add_argument(
        "--families", type=int, default=0, help="pairs of each role of each family, instead of the buildings"
    )
    parser.add_argument("--seed", type=int, default=300_000)
    parser.add_argument("--cache", type=Path, default=None, help="folder for generated maps")
    parser.add_argument("--clouds", action="store_true", help="take all free space from the maps")
    parser.add_argument(
        "--part", default="1/1", help="2/3: the second of three processes that share the work"
    )
    parser.add_argument(
        "--join", type=Path, nargs="*", default=[], help="outputs of other runs, for the summary"
    )
    parser.add_argument("--out", type=Path, default=Path("bench/out/calibration.json"))
    parser.add_argument("--table", action="store_true", help="print the summary of --out, run nothing")
    parser.add_argument("--plot", type=Path, default=None, help="where to draw the reliability diagram (PNG)")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Run the benchmark; rows already in the output file (of an earlier, stopped run) are kept."""
    args = _parse(argv)
    rows: list[dict] = json.loads(args.out.read_text())["rows"] if args.out.exists() else []
    if not args.table:
        print(setting())
        _register(args, rows)
    rows += [row for path in args.join for row in json.loads(path.read_text())["rows"]]
    if not rows:
        print(
            f"bench calibration: there is no file {args.out}; run it, or name one with --out.",
            file=sys.stderr,
        )
        return 2
    print("\n".join(family_table(rows) if args.families else summary(rows)))
    if args.plot is not None:
        draw(rows, args.plot)
    return 0


def _register(args: argparse.Namespace, rows: list[dict]) -> None:
    """Register the pairs of this part that have no row yet; each row is added and written to --out at once."""
    part, parts = (int(word) for word in args.part.split("/"))
    done = {r["name"] for r in rows}
    for name, make in _jobs(args)[part - 1 :: parts]:
        if name in done:
            continue
        start = time.perf_counter()
        row = make()
        rows.append({"name": name} | row)
        write_json(args.out, {"rows": rows})
        took = time.perf_counter() - start
        print(
            f"{name:28s} {row['verdict']:10s} {row['confidence']:.3f} right={row['right']!s:5s} {took:.1f} s",
            flush=True,
        )


def _jobs(args: argparse.Namespace) -> list[tuple[str, Callable[[], dict[str, Any]]]]:
    """Names of the pairs, and functions that give their rows."""
    if args.families:
        return [(job.name, partial(family_row, job)) for job in family_jobs(args.families, args.seed)]
    pairs: list[tuple[str, tuple[int, ...]]] = [
        (kind, (seed,))
        for kind, count in (("pair", args.pairs), ("hotel", args.hotels))
        for seed in seeds_of(kind, count, args.seed)
    ]
    pairs += [
        ("cross", two) for two in itertools.combinations(seeds_of("build", args.buildings, args.seed), 2)
    ]
    runner, end = Runner(args.cache, clouds=args.clouds), "_cloud" if args.clouds else ""
    return [
        (f"{kind}_{'_'.join(map(str, seeds))}{end}", partial(runner.row, kind, seeds))
        for kind, seeds in pairs
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
