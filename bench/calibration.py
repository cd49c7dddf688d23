"""Does the confidence mean what it says? Verdicts on generated pairs of one building, equal rooms, other buildings.

    python -m bench calibration [--pairs 170] [--hotels 60] [--buildings 25] [--seed 200000] [--cache FOLDER]

Different buildings: each map against each other one. The seed is another one than that of the worlds that the model of
the verdict was fitted on (100000). Prints the verdicts by kind, the false accepts with the upper 95 % bound of their
rate (Clopper-Pearson), the expected calibration error in ten bins, and how the errors of accepted poses compare with
their covariance; writes JSON and a reliability diagram. `--cache` keeps the generated maps; several processes can share
the work by `--only` and be put together by `--join`.
"""

import argparse
import itertools
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import beta, chi2

import voxjax as vx
from bench.timing import setting
from voxjax.metrics import pose_error
from voxjax.pipeline.config import Config
from voxjax.pipeline.pair import prepare, register_prepared, working_voxel_size
from voxjax.registration.map_features import share_sizes
from voxjax.synthetic import simulate_hotel, simulate_team

FRAMES = ("yaw", "tilt", "so3")
OVERLAPS = (0.1, 0.2, 0.3, 0.45, 0.65)
DEGREES, METRES = 3.0, 0.4
KINDS = {"pair": (0, 1, 4), "hotel": (2,), "build": (3,)}
"""Seeds of a kind: those whose rest after division by five is listed."""


def make_world(seed: int, kind: str) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
    """Maps of a seed and their true pose: a "pair" of one building, a "hotel", or one map of a "build"ing."""
    rng = np.random.default_rng([seed, 99])
    frame = FRAMES[seed % 3]
    clutter, skew = float(rng.uniform(0.3, 2.0)), float(rng.choice([0, 0.15, 0.3]))
    drift = float(rng.uniform(0.02, 0.06))
    plain: dict[str, Any] = {"frame": frame, "clutter": clutter, "skew": skew, "drift": drift}
    if kind == "pair":
        team = simulate_team(seed, overlap=float(rng.choice(OVERLAPS)), **plain)
    elif kind == "hotel":
        team = simulate_hotel(
            seed, frame=frame, drift=drift, rooms_per_side=int(rng.integers(4, 7)),
            shared_columns=int(rng.integers(1, 5)),
        )  # fmt: skip
    else:
        team = simulate_team(seed, num_robots=1, overlap=float(rng.choice([0.4, 0.65])), **plain)
    return list(team.grids), team.true_pose(0, 1) if len(team.grids) == 2 else None


def load_world(seed: int, kind: str, cache: Path | None) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
    """`make_world`, from the cache if it is there."""
    path = None if cache is None else cache / f"{kind}_{seed}.npz"
    if path is not None and path.exists():
        with np.load(path) as kept:
            count = 2 if "s1" in kept else 1
            grids = [vx.VoxelGrid(kept[f"s{i}"], kept[f"o{i}"], float(kept[f"v{i}"])) for i in range(count)]
            return grids, kept["T"] if "T" in kept else None
    grids, T = make_world(seed, kind)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        parts: dict[str, Any] = {}
        for i, g in enumerate(grids):
            parts |= {f"s{i}": g.states, f"o{i}": g.origin, f"v{i}": g.voxel_size}
        if T is not None:
            parts["T"] = T
        np.savez_compressed(path, **parts)
    return grids, T


def seeds_of(kind: str, count: int, first: int) -> list[int]:
    """The first seeds of a kind from `first` on."""
    return list(itertools.islice((first + i for i in itertools.count() if i % 5 in KINDS[kind]), count))


def judge(found: vx.Registration, truth: np.ndarray | None, b: vx.VoxelGrid) -> dict[str, Any]:
    """One row: what was said and what is true."""
    row: dict[str, Any] = {
        "verdict": found.verdict, "confidence": found.confidence, "right": False, "rank": None,
        "rounds": found.stats.get("num_rounds"), "seconds": sum(found.stats["seconds"].values()),
    }  # fmt: skip
    if truth is None:
        return row
    centroid = b.occupied_points().mean(axis=0, dtype=np.float64)
    errors = [pose_error(h.T_a_b, truth, centroid) for h in found.hypotheses]
    good = [e.degrees <= DEGREES and e.metres <= METRES for e in errors]
    row["rank"] = good.index(True) if True in good else None
    row["right"] = row["rank"] == 0
    if row["right"]:
        T = np.asarray(found.T_a_b, np.float64)
        turn = Rotation.from_matrix(truth[:3, :3] @ T[:3, :3].T).as_rotvec()
        shift = (truth - T)[:3] @ np.append(centroid, 1.0)
        row |= {"tangent": [*shift, *turn], "covariance": np.asarray(found.covariance).tolist()}
        row |= {"degrees": errors[0].degrees, "metres": errors[0].metres}
    return row


def calibration_error(confidence: np.ndarray, is_right: np.ndarray, bins: int = 10) -> float:
    """Expected calibration error: mean gap of confidence and share right over equal bins, weighted by count."""
    which = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = [abs(confidence[which == k].sum() - is_right[which == k].sum()) for k in range(bins)]
    return float(sum(gaps) / max(len(confidence), 1))


def upper_bound(events: int, trials: int) -> float:
    """Upper end of the 95 % interval of a rate (Clopper-Pearson, one-sided)."""
    return float(beta.ppf(0.95, events + 1, trials - events)) if events < trials else 1.0


def summary(rows: list[dict]) -> list[str]:
    """Table by kind, calibration, covariance, times."""
    lines = [
        "| pairs | right | in the first 5 | accepted and right | accepted and wrong (95 % bound of the rate) |"
    ]
    lines.append("|---|---|---|---|---|")
    names = {"pair": "one building", "hotel": "equal rooms", "cross": "different buildings"}
    for kind, name in names.items():
        mine = [r for r in rows if r["kind"] == kind]
        if not mine:
            continue
        accepted = [r for r in mine if r["verdict"] == "accepted"]
        wrong = sum(not r["right"] for r in accepted)
        near = sum(r["rank"] is not None and r["rank"] < 5 for r in mine)
        truth = f"{sum(r['right'] for r in mine)} | {near}" if kind != "cross" else "- | -"
        bound = f"{wrong} ({100 * upper_bound(wrong, len(mine)):.1f} %)"
        lines.append(f"| {name} ({len(mine)}) | {truth} | {len(accepted) - wrong} | {bound} |")
    confidence = np.asarray([r["confidence"] for r in rows])
    is_right = np.asarray([r["right"] for r in rows], float)
    lines.append(
        f"\nexpected calibration error {calibration_error(confidence, is_right):.3f} on {len(rows)} pairs"
    )
    balanced = balance(rows)
    lines.append(
        f"half of them of one building: {calibration_error(*balanced[:2]):.3f} on {len(balanced[0])} pairs"
    )
    nees = [
        float(np.asarray(r["tangent"]) @ np.linalg.solve(np.asarray(r["covariance"]), np.asarray(r["tangent"])))
        for r in rows if r["right"] and r["verdict"] == "accepted"
    ]  # fmt: skip
    if nees:
        inside = float(np.mean(np.asarray(nees) <= chi2.ppf(0.95, 6)))
        lines.append(
            f"normalised error squared of {len(nees)} accepted poses: mean {np.mean(nees):.2f} (6 if the covariance is "
            f"right), {100 * inside:.0f} % below the 95 % quantile"
        )
    right = [r for r in rows if r["right"] and r["kind"] == "pair"]
    if right:
        lines.append("error of the right poses of one building, median and 90th percentile: " + ", ".join(
            f"{np.median([r[k] for r in right]):.2f} and {np.percentile([r[k] for r in right], 90):.2f} {unit}"
            for k, unit in (("degrees", "deg"), ("metres", "m"))
        ))  # fmt: skip
    return lines


def balance(rows: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """Confidence and truth of a set whose half is of one building: the others evenly thinned."""
    pairs = [r for r in rows if r["kind"] == "pair"]
    others = [r for r in rows if r["kind"] == "hotel"] + [r for r in rows if r["kind"] == "cross"]
    hotels = [r for r in others if r["kind"] == "hotel"]
    cross = [r for r in others if r["kind"] == "cross"]
    keep = max(len(pairs) - len(hotels), 0)
    chosen = np.unique(np.linspace(0, len(cross) - 1, min(keep, len(cross))).astype(int)) if cross else []
    rows = pairs + hotels + [cross[i] for i in chosen]
    return np.asarray([r["confidence"] for r in rows]), np.asarray([r["right"] for r in rows], float)


def draw(rows: list[dict], path: Path) -> None:
    """Reliability diagram: share right against confidence, and how many pairs each bin holds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    confidence, is_right = balance(rows)
    which = np.minimum((confidence * 10).astype(int), 9)
    fig, (top, bottom) = plt.subplots(2, 1, figsize=(5, 6), height_ratios=(3, 1), sharex=True)
    used = [k for k in range(10) if (which == k).any()]
    top.plot([0, 1], [0, 1], "k:", lw=1)
    top.plot([confidence[which == k].mean() for k in used], [is_right[which == k].mean() for k in used], "o-")
    top.set_ylabel("share of the best poses that are right")
    bottom.bar((np.arange(10) + 0.5) / 10, np.bincount(which, minlength=10), width=0.09)
    bottom.set_xlabel("confidence")
    bottom.set_ylabel("pairs")
    fig.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=110)


def main(argv: list[str]) -> int:
    """Run the benchmark; rows already in the output file (of an earlier, stopped run) are kept."""
    parser = argparse.ArgumentParser(prog="python -m bench calibration", description=__doc__)
    parser.add_argument("--pairs", type=int, default=170, help="pairs of one building")
    parser.add_argument("--hotels", type=int, default=60, help="pairs among equal rooms")
    parser.add_argument(
        "--buildings", type=int, default=25, help="maps of different buildings, each against each"
    )
    parser.add_argument("--seed", type=int, default=200_000)
    parser.add_argument("--cache", type=Path, default=None, help="folder for generated maps")
    parser.add_argument("--only", default="pair,hotel,cross", help="kinds to run")
    parser.add_argument(
        "--join", type=Path, nargs="*", default=[], help="outputs of other runs, for the summary"
    )
    parser.add_argument("--out", type=Path, default=Path("bench/out/calibration.json"))
    parser.add_argument("--plot", type=Path, default=None, help="where to draw the reliability diagram (PNG)")
    args = parser.parse_args(argv)
    print(setting())
    jobs = [("pair", (s,)) for s in seeds_of("pair", args.pairs, args.seed)]
    jobs += [("hotel", (s,)) for s in seeds_of("hotel", args.hotels, args.seed)]
    jobs += [
        ("cross", two) for two in itertools.combinations(seeds_of("build", args.buildings, args.seed), 2)
    ]
    rows: list[dict] = json.loads(args.out.read_text())["rows"] if args.out.exists() else []
    done = {r["name"] for r in rows}
    features: dict[int, Any] = {}
    args.out.parent.mkdir(parents=True, exist_ok=True)
    for kind, seeds in jobs:
        name = f"{kind}_{'_'.join(map(str, seeds))}"
        if kind not in args.only.split(",") or name in done:
            continue
        start = time.perf_counter()
        if kind == "cross":
            for seed in seeds:
                if seed not in features:
                    (grid,), _ = load_world(seed, "build", args.cache)
                    features[seed] = grid, prepare(grid, voxel_size=grid.voxel_size)
            (_, fa), (b, fb) = (features[seed] for seed in seeds)
            truth = None
        else:
            (a, b), truth = load_world(seeds[0], kind, args.cache)
            size = working_voxel_size([a, b], Config())
            fa, fb = prepare(a, voxel_size=size), prepare(b, voxel_size=size)
        row = judge(register_prepared(*share_sizes([fa, fb])), truth, b)
        rows.append({"name": name, "kind": kind} | row)
        args.out.write_text(json.dumps({"rows": rows}))
        took = time.perf_counter() - start
        print(
            f"{name:24s} {row['verdict']:10s} {row['confidence']:.3f} right={row['right']!s:5s} {took:.1f} s",
            flush=True,
        )
    rows += [row for path in args.join for row in json.loads(path.read_text())["rows"]]
    print("\n".join(summary(rows)))
    if args.plot is not None:
        draw(rows, args.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
