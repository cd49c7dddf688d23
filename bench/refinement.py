"""Accuracy, basin of convergence and time of `voxjax.refine`, beside ICP of small_gicp and Open3D in the same run.

    python -m bench refinement [--maps FOLDER] [--only accuracy,basin,...] [--plot docs/img] [--quick] [--table]

accuracy  Starts 0.3 m and 3 degrees off, on the pairs of maps/sim, on generated pairs without drift and with it.
basin     Share converged against the error of the start, to 2 m and 30 degrees, on generated pairs without drift.
solver    10,240 points: warm times, gradients, 64 starts, the first solve of a process; needs an idle machine.
covariance  Errors against two covariances of the same poses.

All methods start from the same poses; their order turns from pair to pair, so that slow spells of the machine hit all
alike. Settings of the peers: see bench/refinement_peers.py. A pose counts as converged within 1 degree and the larger
of 0.15 m and a voxel. The table is printed from the file of results: a part that did not run keeps its earlier rows.

Takes about a minute with `--quick`, on two cores.
"""

import argparse
import sys
from pathlib import Path

import voxjax as vx
from bench import kernel_setting
from bench.cases import maps_folder
from bench.refinement_covariance import covariance_rows
from bench.refinement_parts import Plan, accuracy_rows, basin_rows, full_plan, quick_plan
from bench.refinement_peers import load_refiners
from bench.refinement_solver import solver_rows
from bench.refinement_table import FILE, FOLDER, lines_of, markdown, read, write
from bench.reports import names_in

PARTS = {
    "accuracy": accuracy_rows,
    "basin": basin_rows,
    "solver": solver_rows,
    "covariance": covariance_rows,
}
"""What can be measured, by name; a new part needs an entry here and, to be printed, one in refinement_table.py."""


def main(argv: list[str]) -> int:
    """Run the benchmark; prints what it ran on and a line for each row, and writes the rows as JSON."""
    args = _parse(argv)
    try:
        return _table(args.results) if args.table else _run(args)
    except vx.InputError as error:
        print(f"bench refinement: {error}", file=sys.stderr)
        return 2


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench refinement",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--maps", type=Path, help="folder of test maps; default: VOXJAX_MAPS or ../shared/maps"
    )
    parser.add_argument(
        "--only", default=",".join(PARTS), help=f"parts, by comma; default: {','.join(PARTS)}"
    )
    parser.add_argument("--peers", default="small_gicp,open3d", help='by comma; "" runs voxjax alone')
    parser.add_argument("--pairs", type=int, metavar="N", help="generated pairs of each suite; default: 12")
    parser.add_argument(
        "--starts", type=int, metavar="N", help="random starts of a pair and error; default: 3"
    )
    parser.add_argument("--seed", type=int, default=4000, help="seed of the generated pairs and the starts")
    parser.add_argument("--quick", action="store_true", help="few pairs and starts: under a minute")
    parser.add_argument("--table", action="store_true", help="print the results as Markdown, run nothing")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="draw the results there")
    parser.add_argument("--results", type=Path, default=FOLDER, metavar="FOLDER", help=f"where {FILE} lies")
    args = parser.parse_args(argv)
    for name in ("pairs", "starts"):
        if getattr(args, name) is not None and getattr(args, name) < 1:
            parser.error(f"--{name} must be 1 or more, got {getattr(args, name)}")
    return args


def _run(args: argparse.Namespace) -> int:
    names = names_in(args.only)
    for name in names:
        if name not in PARTS:
            raise vx.InputError(f"part {name!r} is not known; choose from {', '.join(PARTS)}.")
    if args.plot is not None:
        from bench.plots import prepare_plots

        prepare_plots()
    plan = _plan(args)
    refiners = load_refiners(names_in(args.peers))
    setting = kernel_setting.describe() | {k: v for r in refiners for k, v in r.versions().items()}
    print("\n".join(f"{name:<16} {value}" for name, value in setting.items()))
    for name in names:
        print(f"\n{name}", flush=True)
        rows = []
        for row in PARTS[name](plan, refiners):
            rows.append(row)
            print("\n".join(lines_of(row)), flush=True)
        write(args.results / FILE, name, {"setting": setting, "quick": args.quick, "rows": rows})
    print(args.results / FILE)
    if args.plot is not None:
        from bench.refinement_plots import draw

        print("\n".join(str(path) for path in draw(read(args.results / FILE), args.plot)))
    return 0


def _plan(args: argparse.Namespace) -> Plan:
    make = quick_plan if args.quick else full_plan
    return make(maps_folder(args.maps), args.seed, pairs=args.pairs, starts=args.starts)


def _table(folder: Path) -> int:
    print(markdown(read(folder / FILE)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
