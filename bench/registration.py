"""Recall, wrong accepts, errors and times of `voxjax.register`, beside peers on the same maps in the same run.

    python -m bench registration [--peers kiss-matcher,open3d] [--generated N --seed S] [--maps FOLDER --only sim,real]
    python -m bench registration --only real --generated 0 --reframings 10 --half [--maps FOLDER] [--resume]

A pose is right when its rotation is within 3 degrees and map b's centroid within 0.4 m or 3 voxels of the truth; for
real maps, within the tolerances of their truth files, also when they are re-framed or coarsened. Re-framed are both
maps of a pair, each turned anyhow and shifted: measured points are moved and put into voxels anew, maps that hold free
space are resampled, to the nearest voxel. `--turns upright` keeps their vertical axes, `--turns cube` turns by right
angles and shifts by whole voxels, so that only the frames differ. A second table has these pairs one by one. Methods
take turns pair by pair, so that slow spells of the machine hit all alike. The JSON file is written after every pair.

Takes about 20 minutes for all variants of seventeen real pairs, on two cores.
"""

import argparse
import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import voxjax as vx
from bench.cases import TURNS, Case, folder_cases, generated_cases, maps_folder
from bench.peers import Peer, load_peers, run_peer
from bench.plots import draw_plots, prepare_plots
from bench.reports import names_in, write_json
from bench.summary import Row, markdown, summarize
from bench.timing import setting, turned
from bench.variant_table import variant_table
from bench.worlds import MapPair

Method = Callable[[Case, MapPair], Row]


def main(argv: list[str]) -> int:
    """Run the benchmark; prints a line for each pair and method and a summary, and writes JSON."""
    args = _parse(argv)
    try:
        if args.table:
            print(_tables(_kept(args.out)["rows"]))
            return 0
        return _run(args)
    except vx.InputError as error:
        print(f"bench registration: {error}", file=sys.stderr)
        return 2


def _tables(rows: list[Row]) -> str:
    """The summary, and the table of the variants of real pairs if some were run."""
    return "\n\n".join(filter(None, (markdown(rows), variant_table(rows))))


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench registration",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument(
        "--maps", type=Path, help="folder of test maps; default: VOXJAX_MAPS or ../shared/maps"
    )
    parser.add_argument("--only", default="sim,real", help='folders of the maps to take; "" takes none')
    parser.add_argument("--case", action="append", default=[], help="only cases whose name contains this")
    parser.add_argument("--presets", default="default", help="of voxjax, by comma; default: default")
    parser.add_argument("--peers", default="", help="other systems, by comma: kiss-matcher, open3d, teaser")
    parser.add_argument("--generated", type=int, default=60, help="fresh generated pairs; default: 60")
    parser.add_argument("--seed", type=int, default=1000, help="of the generated pairs and re-framings")
    parser.add_argument(
        "--reframings", type=int, default=0, help="variants of each real pair, turned and shifted"
    )
    parser.add_argument(
        "--turns", choices=TURNS, default="any", help="of the variants: anyhow, upright, by right angles"
    )
    parser.add_argument("--half", action="store_true", help="also each real pair at twice the voxel size")
    parser.add_argument("--warm", action="store_true", help="call each method once before the timed call")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="write recall.png and errors.png there")
    parser.add_argument("--out", type=Path, default=Path("bench/out/registration.json"))
    parser.add_argument("--resume", action="store_true", help="keep the rows of --out, run what is missing")
    parser.add_argument("--table", action="store_true", help="print the summary of --out, run nothing")
    return parser.parse_args(argv)


def _run(args: argparse.Namespace) -> int:
    peers = load_peers(names_in(args.peers))
    methods = {f"voxjax {preset}": _voxjax(preset) for preset in _presets(args.presets)}
    methods |= {peer.name: _peer(peer) for peer in peers}
    if not methods:
        raise vx.InputError("there is nothing to run: name a preset with --presets or a peer with --peers.")
    if args.plot is not None:
        prepare_plots()
    rows = _rows(args, methods, _environment(peers))
    print(f"\n{_tables(rows)}")
    if args.plot is not None:
        print("\n" + "\n".join(f"wrote {path}" for path in draw_plots(rows, args.plot)))
    return 0


def _rows(args: argparse.Namespace, methods: dict[str, Method], environment: dict[str, Any]) -> list[Row]:
    """Rows of all cases, method by method; they are written to --out after every case, those of --resume with them."""
    cases = _cases(args)
    settings = {"maps": str(args.maps or os.environ.get("VOXJAX_MAPS", "")), "warm": args.warm}
    rows = _resumed(args.out, settings) if args.resume else []
    print(setting())
    # Methods run in turns on each case, so that slow spells of the machine hit all alike.
    for turn, case in enumerate(cases):
        done = {row["method"] for row in rows if row["case"] == case.name}
        names = [name for name in methods if name not in done]
        if not names:
            continue
        pair = case.load()
        for name in turned(names, turn):
            row = _measure(name, methods[name], case, pair, warm=args.warm)
            rows.append(row)
            print(_line(row), flush=True)
        write_json(args.out, {"environment": environment, "settings": settings, "rows": rows})
    order = list(methods)
    rows.sort(key=lambda row: order.index(row["method"]) if row["method"] in order else len(order))
    contents = {"environment": environment, "settings": settings, "summary": summarize(rows), "rows": rows}
    write_json(args.out, contents)
    return rows


def _presets(text: str) -> list[str]:
    names, known = names_in(text), ("default", "paper")
    for name in names:
        if name not in known:
            raise vx.InputError(f"preset {name!r} is not known; choose from {', '.join(known)}.")
    return names


def _cases(args: argparse.Namespace) -> list[Case]:
    cases: list[Case] = []
    sources = names_in(args.only)
    root = maps_folder(args.maps, is_wanted=bool(sources))
    if root is not None:
        cases = folder_cases(
            root,
            sources,
            num_reframings=args.reframings,
            turns=args.turns,
            with_half=args.half,
            seed=args.seed,
        )
    cases += generated_cases(args.generated, args.seed)
    cases = [case for case in cases if not args.case or any(part in case.name for part in args.case)]
    if not cases:
        raise vx.InputError(
            "there is no pair to run; check --maps, --only and --case, or give --generated N."
        )
    return cases


def _voxjax(preset: Any) -> Method:
    def run(case: Case, pair: MapPair) -> Row:
        start = time.perf_counter()
        found = vx.register(pair.a, pair.b, preset=preset)
        seconds = time.perf_counter() - start
        leaders = found.hypotheses
        row: Row = {
            "seconds": seconds,
            "verdict": found.verdict,
            "accepted": found.accepted,
            "reason": found.reason,
            "confidence": float(found.confidence),
            "stages": found.stats["seconds"],
            "clique_size": found.stats.get("clique_size"),
        }
        if leaders:
            row |= {
                "source_of_pose": leaders[0].source,
                "score": float(leaders[0].score),
                "conflict": float(leaders[0].evidence.free_conflict),
                "rival": float(leaders[1].score) if len(leaders) > 1 else 0.0,
            }
        return row | case.judge([np.asarray(h.T_a_b) for h in leaders], pair.T_a_b, pair.centroid_of_b)

    return run


def _peer(peer: Peer) -> Method:
    def run(case: Case, pair: MapPair) -> Row:
        a, b = pair.a.occupied_points(), pair.b.occupied_points()
        is_real = case.source not in ("sim", "generated")
        answer = run_peer(peer, a, b, voxel_size=max(pair.a.voxel_size, pair.b.voxel_size), is_real=is_real)
        verdict = {None: "-", True: "valid", False: "not valid"}[answer.is_valid]
        row: Row = {
            "seconds": answer.seconds,
            "refine_seconds": answer.refine_seconds,
            "verdict": verdict,
            "accepted": answer.is_valid,
            "score": answer.score,
        }
        return row | case.judge([answer.T_a_b], pair.T_a_b, pair.centroid_of_b)

    return run


def _measure(name: str, method: Method, case: Case, pair: MapPair, *, warm: bool) -> Row:
    """The method's row; with `warm` the row is of a second call, and holds the time of the first."""
    first = {"first_seconds": method(case, pair)["seconds"]} if warm else {}
    about: Row = {
        "case": case.name,
        "method": name,
        "source": case.source,
        "kind": case.kind,
        "rotation": case.rotation,
        "overlap": pair.overlap,
        "options": case.options,
        "voxel_size": pair.a.voxel_size,
        "num_occupied": [pair.a.num_occupied, pair.b.num_occupied],
    }
    return about | first | method(case, pair)


def _line(row: Row) -> str:
    error = " " * 21 if row["degrees"] is None else f"{row['degrees']:6.2f} deg {row['metres']:6.3f} m"
    return (
        f"{row['case']:32s} {row['overlap']:.2f} {row['method']:15s} {row['verdict']:10s} {error} "
        f"right={row['right']!s:5s} rank={row['rank']!s:4s} {row['seconds']:6.1f} s  "
        f"{row.get('score', 0.0):.3f} {row.get('source_of_pose', '')}"
    )


def _environment(peers: list[Peer]) -> dict[str, Any]:
    versions = {name: importlib.metadata.version(name) for name in ("jax", "jaxlib", "numpy")}
    for peer in peers:
        versions |= peer.versions()
    return {
        "python": platform.python_version(),
        "voxjax": vx.__version__,
        "device": str(jax.devices()[0]),
        "cores": os.cpu_count(),
        "versions": versions,
    }


def _resumed(path: Path, settings: dict[str, Any]) -> list[Row]:
    """Rows of an earlier run, if it read the same maps in the same way; none if there is no file yet."""
    if not path.exists():
        return []
    earlier = _kept(path)
    if earlier["settings"] != settings:
        raise vx.InputError(
            f"{path} was run with {earlier['settings']}, not {settings}; leave out --resume or change --out."
        )
    return earlier["rows"]


def _kept(path: Path) -> dict[str, Any]:
    """What an earlier run wrote, with "rows" and "settings"."""
    try:
        kept = json.loads(path.read_text())
        return {"rows": list(kept["rows"]), "settings": kept["settings"]}
    except FileNotFoundError as error:
        raise vx.InputError(
            f"there is no file {path}; run the benchmark, or name a file with --out."
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise vx.InputError(
            f"{path} is no result of this benchmark; leave out --resume, or change --out."
        ) from error


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
