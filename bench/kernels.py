"""Every kernel against its references: times, ratios, targets, share of the memory's speed.

    python -m bench kernels [--quick] [--only SUBSTRING] [--device NAME] [--gate] [--table] [--plot FOLDER]

Runs the rows of all modules of bench/kernel_rows. The candidates of a row run in one process, in turns, as
bench/timing.py says, and a widening copy (uint8 to uint16) runs with them: it is the limit that shares are of.

Results go to bench/results, one file per kind of device. On Linux most of the time of a fresh large array is spent in
page faults, so results with the default and with a tuned allocator are kept apart; for the second, run it under

    {tuned}

Takes about a minute with `--quick`, on two cores.
"""

import argparse
import gc
import importlib
import pkgutil
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import bench.kernel_rows
from bench import kernel_results, kernel_setting
from bench.kernel_row import KernelRow
from bench.timing import time_interleaved


def main(argv: list[str]) -> int:
    """Run the benchmark; 1 if a module of rows failed or, with --gate, a ratio fell."""
    args = _parse(argv)
    if args.table:
        print(tables(args.results))
        return 0
    if args.device:
        jax.config.update("jax_platforms", args.device)
    if args.plot is not None:
        from bench.kernel_plots import prepare_plots

        prepare_plots()
    setting = kernel_setting.describe()
    print("\n".join(f"{name:<16} {value}" for name, value in setting.items()))
    path = args.results / kernel_setting.file_name(setting["device"])
    results, num_failed = [], 0
    for name in module_names():
        try:
            for result in _measure(name, args, setting):
                results.append(result)
                print("\n".join(kernel_results.lines_of(result)), flush=True)
        except Exception:  # one module's fault must not hide the rows of the others
            traceback.print_exc()
            print(f"\nbench/kernel_rows/{name}.py FAILED", file=sys.stderr)
            num_failed += 1
    judged = [r["met"] for r in results if r["met"] is not None]
    print(
        f"\n{len(results)} rows, {sum(judged)} of {len(judged)} with a target met it, {num_failed} modules failed"
    )
    if args.plot is not None:
        from bench.kernel_plots import draw

        for picture in draw(args.plot, results, largest=1024 if args.large else 128 if args.quick else 512):
            print(picture)
    if args.gate:
        return _gate(results, path) or int(num_failed > 0)
    if results:
        kernel_results.write(path, results)
        print(path)
    return int(num_failed > 0)


def module_names() -> list[str]:
    """Modules of bench/kernel_rows that have rows."""
    found = [info.name for info in pkgutil.iter_modules(bench.kernel_rows.__path__)]
    folder = Path(bench.kernel_rows.__path__[0])
    return [name for name in sorted(found) if "\ndef rows(" in (folder / f"{name}.py").read_text()]


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench kernels",
        description=(__doc__ or "").format(tuned=f"{kernel_setting.TUNED} python -m bench kernels"),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="small grids, few rounds: under a minute")
    parser.add_argument(
        "--only", default="", metavar="SUBSTRING", help="modules or rows whose name contains it"
    )
    parser.add_argument("--device", help="platform to run on: cpu, cuda, ...")
    parser.add_argument("--rounds", type=int, help="timed calls of each candidate")
    parser.add_argument("--gate", action="store_true", help="compare with the committed results, write none")
    parser.add_argument(
        "--table", action="store_true", help="print the committed results as Markdown, run nothing"
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FOLDER", help="measure and draw throughput against size"
    )
    parser.add_argument("--large", action="store_true", help="with --plot: up to 1024 cubed")
    parser.add_argument("--results", type=Path, default=kernel_results.FOLDER, metavar="FOLDER")
    args = parser.parse_args(argv)
    if args.rounds is not None and args.rounds < 1:
        parser.error(f"--rounds must be 1 or more, got {args.rounds}")
    return args


def _measure(name: str, args: argparse.Namespace, setting: dict[str, str]) -> Iterator[dict]:
    """Results of one module, row by row; a row's arrays are freed before the next row is built."""
    if args.only in module_names() and args.only != name:
        return
    module = importlib.import_module(f"bench.kernel_rows.{name}")
    source = iter(module.rows(quick=args.quick))
    while (row := next(source, None)) is not None:
        if args.only in row.name or args.only in name:
            yield _result(row, args, setting)
        del row
        gc.collect()


def _result(row: KernelRow, args: argparse.Namespace, setting: dict[str, str]) -> dict:
    """Time one row, the limit with it where memory is its limit."""
    candidates = dict(row.candidates)
    if row.bytes_moved:
        candidates["limit: widening copy"] = widening_copy()
    timings = time_interleaved(candidates, rounds=args.rounds or (5 if args.quick else 7))
    limit = 0.0
    if row.bytes_moved:
        bytes_widened = 3 * _limit_side() ** 3  # one byte is read for each voxel, two are written
        limit = bytes_widened / timings[-1].median_s
        timings = timings[:-1]
    return kernel_results.result_of(row, timings, limit, setting, args.quick)


def widening_copy() -> Callable[[], object]:
    """Copy a grid of uint8 to uint16: on CPU into memory that is there already, so that no page fault is timed."""
    side = _limit_side()
    if jax.devices()[0].platform == "cpu":
        source, target = np.zeros(side**3, np.uint8), np.zeros(side**3, np.uint16)
        return lambda: np.copyto(target, source)
    widen, grid = jax.jit(lambda x: x.astype(jnp.uint16)), jnp.zeros(side**3, jnp.uint8)
    return lambda: widen(grid)


def _limit_side() -> int:
    """Edge of the grid that is copied: larger than the caches."""
    return 512 if jax.devices()[0].platform == "gpu" else 256


def _gate(results: list[dict], path: Path) -> int:
    """Print ratios that fell against the committed ones; return 1 if any did, 2 if nothing is committed."""
    baseline = kernel_results.read(path)
    if not baseline:
        print(f"gate: no committed results for this kind of device ({path})", file=sys.stderr)
        return 2
    lines = kernel_results.falls(results, baseline)
    for line in lines:
        print(f"gate: {line}", file=sys.stderr)
    print(f"gate: {len(lines)} ratios fell by more than {100 * kernel_results.LARGEST_FALL:.0f} %")
    return int(bool(lines))


def tables(folder: Path) -> str:
    """Markdown tables of all files of results, and what is still missing."""
    parts, has_gpu = [], False
    for rows in kernel_results.read_all(folder):
        setting = rows[0]["setting"]
        has_gpu |= setting["allocator"] == "device"
        versions = ", ".join(f"{name} {setting[name]}" for name in ("jax", "numpy", "scipy"))
        parts.append(f"**{setting['device']}** ({versions})\n\n{kernel_results.table(rows)}")
    if not has_gpu:
        parts.append("**GPU**: not yet measured.")
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
