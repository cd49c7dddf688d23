"""Does the confidence mean what it says? Verdicts on generated pairs of one building, equal rooms, other buildings.

    python -m bench calibration [--pairs 200] [--hotels 60] [--buildings 25] [--seed 300000] [--cache FOLDER]
    python -m bench calibration --families 18 [--role negatives] [--family street forest] [--part 1/2] [--peers NAMES]
    python -m bench calibration --rows FILE ... [--plot PNG]

Different buildings: each map against each other one. The seed is another one than that of the worlds that the model of
the verdict was fitted on (100000, `python -m bench verdict_fit`). Prints the verdicts by kind, the false accepts with
the upper 95 % bound of their rate (Clopper-Pearson), the expected calibration error in ten bins, and how the errors of
accepted poses compare with their covariance; `--plot` draws the reliability diagram. `--cache` keeps the generated
maps. `--clouds` takes all free space from the maps.

`--families N` takes N pairs of each role of each family of places instead, with free space and without
(`bench/family_rows.py`), and prints its tables by family beside what was asked: 92 pairs without a true pose and 60
with one for each of the N. `--families 18 --role negatives` are 1,656 pairs, 1,500 and more of them no nearer to a true
pose than by 5 % of size. Their diagram has a panel for each family.

Each row is written to --out at once. A run that was stopped goes on with the same command; processes that share the
work by `--part 1/2` and `--part 2/2` write files of their own, and `--rows` prints the tables of several files at once
and runs nothing. After a change of the code give another --out: rows that are there are not measured again.

`--peers kiss-matcher` asks other systems about the same pairs of families, also those whose rows are there: what each
calls valid, what it has right, and its seconds stand beside voxjax. Their voxels are 2.5 of the maps', at most 0.3 m.

Takes about 4 to 11 s for each pair of `--families`, on two cores.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bench.building_rows import building_jobs
from bench.families import FAMILIES, ROLES
from bench.family_peer_table import peer_table, peers_of
from bench.family_rows import NEGATIVES, family_jobs, family_row
from bench.family_tables import family_tables
from bench.peers import Peer, load_peers
from bench.plots import prepare_plots
from bench.reliability import summary
from bench.reliability_plots import draw, draw_families
from bench.reports import names_in, write_json
from bench.timing import setting
from voxjax import InputError


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench calibration",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--pairs", type=int, default=200, help="pairs of one building")
    parser.add_argument("--hotels", type=int, default=60, help="pairs among equal rooms")
    parser.add_argument(
        "--buildings", type=int, default=25, help="maps of different buildings, each against each"
    )
    parser.add_argument(
        "--families", type=int, default=0, help="pairs of each role of each family, instead of the buildings"
    )
    parser.add_argument(
        "--role", nargs="+", choices=(*ROLES, "negatives"), default=ROLES, help="roles of --families"
    )
    parser.add_argument("--family", nargs="+", choices=FAMILIES, default=FAMILIES, help="some of --families")
    parser.add_argument(
        "--peers", default="", help="other systems beside --families, by comma: kiss-matcher, ..."
    )
    parser.add_argument("--seed", type=int, default=300_000)
    parser.add_argument("--cache", type=Path, default=None, help="folder for generated maps")
    parser.add_argument(
        "--clouds", action="store_true", help="take all free space from the maps; of --families, clouds only"
    )
    parser.add_argument(
        "--part", type=_part, default=(1, 1), help="2/3: the second of three that share the work"
    )
    parser.add_argument(
        "--rows", type=Path, nargs="+", help="files of earlier runs: print their tables, run nothing"
    )
    parser.add_argument("--out", type=Path, default=None, help="JSON; default: bench/out/calibration*.json")
    parser.add_argument("--plot", type=Path, default=None, help="where to draw the reliability diagram (PNG)")
    return parser.parse_args(argv)


def _part(text: str) -> tuple[int, int]:
    """The part and the number of parts of the command line.

    Raises:
        argparse.ArgumentTypeError: If the text is no part of a whole.
    """
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and 1 <= int(first) <= int(second)):
        raise argparse.ArgumentTypeError(f"must be like 1/2, got {text!r}")
    return int(first), int(second)


def main(argv: list[str]) -> int:
    """Run the benchmark; rows already in the output file (of an earlier, stopped run) are kept."""
    args = _parse(argv)
    try:
        if args.plot is not None:
            prepare_plots()
        rows = (
            _register(args) if args.rows is None else [row for path in args.rows for row in kept_rows(path)]
        )
        _report(rows, args.plot)
    except InputError as error:
        print(f"bench calibration: {error}", file=sys.stderr)
        return 2
    return 0


def kept_rows(path: Path) -> list[dict[str, Any]]:
    """Rows that an earlier run wrote.

    Raises:
        InputError: If there is no such file, or if it was written by something else.
    """
    try:
        return list(json.loads(path.read_text())["rows"])
    except FileNotFoundError as error:
        raise InputError(f"there is no file {path}; run the benchmark, or name one of its files.") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is no result of this benchmark; name another file.") from error


def _report(rows: list[dict[str, Any]], plot: Path | None) -> None:
    """Print the tables of the rows, those of families and those of buildings, and draw their diagram.

    Raises:
        InputError: If a pair is there twice, or if one picture cannot hold all rows.
    """
    names = [row["name"] for row in rows]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the pair {twice} is there twice; name each file of rows once.")
    families = [row for row in rows if "role" in row]
    buildings = [row for row in rows if "role" not in row]
    if families:
        print("\n".join(family_tables(families)))
    if peers_of(families):
        print(f"\n{peer_table(families)}")
    if buildings:
        print("\n".join(summary(buildings)))
    if plot is None:
        return
    if families and buildings:
        raise InputError("--plot draws families or buildings; name files of one of them with --rows.")
    draw_families(families, plot) if families else draw(buildings, plot)


def _register(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Register the pairs of this part that have no row yet, or not that of a peer; --out is written after each."""
    peers = load_peers(names_in(args.peers))
    if peers and not args.families:
        raise InputError("--peers takes part in --families alone; give --families N.")
    out = _output(args) if args.out is None else args.out
    rows = {row["name"]: row for row in kept_rows(out)} if out.exists() else {}
    part, parts = args.part
    jobs = [
        job for job in _jobs(args, peers, rows)[part - 1 :: parts] if _is_missing(rows.get(job[0]), peers)
    ]
    print(f"{setting()}\n{len(jobs)} pairs to run, {len(rows)} in {out}")
    for name, make in jobs:
        start = time.perf_counter()
        rows[name] = row = {"name": name} | make()
        write_json(out, {"rows": list(rows.values())})
        took = time.perf_counter() - start
        said = f"{row['verdict']:10s} {row['confidence']:.3f} right={row['right']!s:5s} {took:.1f} s"
        print(f"{name:28s} {said}", flush=True)
    if not rows:
        raise InputError("there is no pair to run; check --role, --family and the numbers of pairs.")
    return list(rows.values())


def _is_missing(row: dict[str, Any] | None, peers: list[Peer]) -> bool:
    """Whether a pair has no row yet, or one without some of the peers."""
    return row is None or any(peer.name not in row.get("peers", {}) for peer in peers)


def _output(args: argparse.Namespace) -> Path:
    """The file of this part, another one for each part: two processes must not write one file."""
    part, parts = args.part
    kind, end = "_families" * bool(args.families), f"_{part}_of_{parts}" if parts > 1 else ""
    return Path(f"bench/out/calibration{kind}{end}.json")


def _jobs(
    args: argparse.Namespace, peers: list[Peer], rows: dict[str, dict[str, Any]]
) -> list[tuple[str, Callable[[], dict[str, Any]]]]:
    """Names of the pairs, and functions that give their rows; those that are there already get the peers' answers."""
    if not args.families:
        counts = args.pairs, args.hotels, args.buildings
        return building_jobs(counts, args.seed, cache=args.cache, clouds=args.clouds)
    roles = {*args.role, *(NEGATIVES if "negatives" in args.role else ())}
    return [
        (job.name, partial(family_row, job, peers, rows.get(job.name)))
        for job in family_jobs(args.families, args.seed)
        if job.role in roles and job.family in args.family and not (args.clouds and job.has_free_space)
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
