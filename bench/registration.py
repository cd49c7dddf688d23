"""Recall, wrong accepts, errors and times of `voxjax.register`, by preset, on test maps and on generated ones.

    python -m bench registration [--maps FOLDER] [--only sim,real] [--presets default,paper] [--generated N] [--seed S]

A pose is right when its rotation is within 3 degrees and map b's centroid within 0.4 m or 3 voxels of the truth; for
real maps, within the tolerances of their truth files.
"""

import argparse
import json
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np

import voxjax as vx
from bench.timing import setting
from bench.worlds import pair_case
from voxjax.metrics import pose_error


def cases_in(folder: Path, kinds: list[str], names: list[str]) -> list[dict]:
    """Pairs with a truth file below `folder`, with lazily read maps."""
    cases = []
    for kind in kinds:
        for path in sorted((folder / kind).glob("*/truth.json")):
            truth = json.loads(path.read_text())
            name = f"{kind}/{path.parent.name}"
            if truth["kind"] == "team" or (names and not any(n in name for n in names)):
                continue
            files = [
                next(f for f in (path.parent / f"{m}.bt", path.parent / f"{m}.ply") if f.exists())
                for m in "ab"
            ]
            size = truth["resolution"]
            cases.append(
                {
                    "name": name,
                    "kind": truth["kind"],
                    "load": lambda f=files, v=size, t=truth: _read(f, v, t),
                    **_bounds(truth),
                }
            )
    return cases


def _read(
    files: list[Path], voxel_size: float, truth: dict
) -> tuple[vx.VoxelGrid, vx.VoxelGrid, np.ndarray | None]:
    a, b = (vx.read_map(f, voxel_size=voxel_size if f.suffix == ".ply" else None) for f in files)
    T = truth.get("T_a_b")
    return a, b, None if T is None else np.asarray(T)


def _bounds(truth: dict) -> dict:
    overlap = min(truth.get("overlap_b_in_a", 0.0), truth.get("overlap_a_in_b", 0.0))
    return {
        "overlap": overlap,
        "degrees": truth.get("rot_tol_deg", 3.0),
        "metres": truth.get("trans_tol_m", max(0.4, 3 * truth["resolution"])),
    }


def generated_cases(count: int, seed: int) -> list[dict]:
    """Generated pairs: three of five of one building, others of different buildings or of equal rooms."""
    cases = []
    for case in (pair_case(seed + i) for i in range(count)):
        cases.append(
            {
                "name": case.name,
                "kind": case.kind,
                "load": case.make,
                "overlap": None,
                "degrees": 3.0,
                "metres": 0.4,
            }
        )
    return cases


def run_case(case: dict, preset: Literal["default", "paper"]) -> dict[str, Any]:
    """Register one pair and hold it against the truth."""
    a, b, truth = case["load"]()
    start = time.perf_counter()
    found = vx.register(a, b, preset=preset)
    row: dict[str, Any] = {
        "case": case["name"], "kind": case["kind"], "preset": preset, "overlap": case["overlap"],
        "verdict": found.verdict, "confidence": round(found.confidence, 4), "seconds": time.perf_counter() - start,
        "stages": found.stats["seconds"], "source": found.stats.get("source"), "right": None, "rank": None,
        "clique_size": found.stats.get("clique_size"), "reason": found.reason,
    }  # fmt: skip
    if found.hypotheses:
        best = found.hypotheses[0]
        row |= {"score": best.score, "conflict": best.evidence.free_conflict,
                "rival": found.hypotheses[1].score if len(found.hypotheses) > 1 else 0.0}  # fmt: skip
    if truth is not None:
        centroid = b.occupied_points().mean(axis=0, dtype=np.float64)
        errors = [pose_error(h.T_a_b, truth, centroid) for h in found.hypotheses]
        good = [e.degrees <= case["degrees"] and e.metres <= case["metres"] for e in errors]
        row["right"] = bool(good and good[0])
        row["rank"] = good.index(True) if True in good else None
        if errors:
            row |= {"degrees": errors[0].degrees, "metres": errors[0].metres}
    return row


def summary(rows: list[dict]) -> list[str]:
    """The lines that matter: recall by overlap, wrong accepts by kind, errors, times."""
    lines = []
    for preset in sorted({r["preset"] for r in rows}):
        mine = [r for r in rows if r["preset"] == preset]

        def count(label: str, chosen: list[dict], lines: list[str] = lines, preset: str = preset) -> None:
            right = [r for r in chosen if r["right"]]
            accepted = sum(r["verdict"] == "accepted" for r in right)
            wrong = [r["case"] for r in chosen if r["verdict"] == "accepted" and not r["right"]]
            if chosen:
                lines.append(
                    f"| {preset} | {label} | {len(right)}/{len(chosen)} | {accepted} | {len(wrong)} {' '.join(wrong)} |"
                )

        for origin in sorted({r["case"].split("/")[0] for r in mine}):
            here = [r for r in mine if r["case"].startswith(origin)]
            pairs = [r for r in here if r["kind"] == "pair"]
            known = [r for r in pairs if r["overlap"] is not None]
            if origin == "sim":
                count("sim, overlap >= 0.2", [r for r in known if r["overlap"] >= 0.2])
                count("sim, overlap < 0.2", [r for r in known if r["overlap"] < 0.2])
            else:
                count(f"{origin}, one place", pairs)
            count(f"{origin}, equal rooms", [r for r in here if r["kind"] == "hotel"])
            count(f"{origin}, different buildings", [r for r in here if r["kind"] == "none"])
        right = [r for r in mine if r["right"]]
        if right:
            degrees, metres = (np.median([r[k] for r in right]) for k in ("degrees", "metres"))
            lines.append(
                f"| {preset} | median error of the right ones | {degrees:.2f} deg, {metres:.3f} m | | |"
            )
        times = [r["seconds"] for r in mine]
        lines.append(
            f"| {preset} | seconds a pair, median and 95th percentile | "
            f"{np.median(times):.1f}, {np.percentile(times, 95):.1f} | | |"
        )
    return lines


def main(argv: list[str]) -> int:
    """Run the benchmark; prints a row a pair and a summary, and writes JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench registration", description=__doc__)
    parser.add_argument("--maps", type=Path, default=Path(os.environ.get("VOXJAX_MAPS", "../shared/maps")))
    parser.add_argument("--only", default="sim,real", help="folders of the maps to take")
    parser.add_argument("--case", action="append", default=[], help="only cases whose name contains this")
    parser.add_argument("--presets", default="default,paper")
    parser.add_argument("--generated", type=int, default=0, help="also so many generated pairs")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=Path("bench/out/registration.json"))
    args = parser.parse_args(argv)
    cases = (
        cases_in(args.maps, [k for k in args.only.split(",") if k], args.case) if args.maps.is_dir() else []
    )
    cases += generated_cases(args.generated, args.seed)
    if not cases:
        print(
            f"no pairs below {args.maps}; name a folder with --maps or ask for --generated N", file=sys.stderr
        )
        return 2
    print(setting())
    rows = []
    for case in cases:
        for preset in args.presets.split(","):
            row = run_case(case, preset)
            rows.append(row)
            error = f"{row['degrees']:6.2f} deg {row['metres']:6.3f} m" if "degrees" in row else " " * 21
            print(
                f"{row['case']:28s} {preset:8s} {row['verdict']:10s} {row['confidence']:.3f} {error} "
                f"right={row['right']!s:5s} rank={row['rank']!s:4s} "
                f"{row.get('score', 0):.3f}/{row.get('rival', 0):.3f} "
                f"{row['seconds']:6.1f} s  {row['source']}",
                flush=True,
            )
    print("\n| preset | pairs | right | of them accepted | wrong accepts |\n|---|---|---|---|---|")
    print("\n".join(summary(rows)))
    args.out.parent.mkdir(parents=True, exist_ok=True)
    meta = {"python": platform.python_version(), "jax": jax.__version__, "device": str(jax.devices()[0])}
    args.out.write_text(json.dumps({"environment": meta, "rows": rows}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
