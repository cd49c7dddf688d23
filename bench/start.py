"""Start of the command: imports, kernels that an earlier process compiled, `voxjax merge` in all.

    python -m bench start [--rounds N] [--seed S] [--overlap SHARE] [--tuned]

Generates two maps of one building (by default of 200,000 and 174,000 occupied voxels) and an empty cache of compiled
kernels, and runs processes of their own: one that compiles, then `--rounds` that find all kernels in the cache. A
process imports what the command imports, whose seconds stand on a line of their own, and runs `register` three times;
what the first run takes beyond the later ones is the time until its kernels are ready: to trace them, to lower them, to
compile them or load them. Later processes load them in the background from the time on at which they say where the
cache is, before the maps are read. `voxjax merge` is timed from the outside.
`--tuned` also runs `merge` under the allocator setting of `bench/kernel_setting.py`, in turns with the default. Run it
on an idle machine.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import voxjax as vx
from bench.kernel_setting import TUNED
from bench.timing import round_count, setting
from voxjax.synthetic import simulate_team

_DURATIONS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile or load",
}
_EVENTS = {"/jax/compilation_cache/cache_hits": "hits", "/jax/compilation_cache/cache_misses": "misses"}


class Run(NamedTuple):
    """A process that has ended.

    Attributes:
        seconds: Time from the start of the process to its end [s].
        output: Text that the process printed.
    """

    seconds: float
    output: str


def measure(path_a: str, path_b: str, cache: str) -> dict[str, float]:
    """Register two maps in this process [s], and add up what JAX says of its kernels until the first run's end."""
    import jax

    import voxjax.cli.merge  # noqa: F401  # `register` imports nothing more: what is left are kernels

    found = dict.fromkeys((*_DURATIONS.values(), *_EVENTS.values()), 0.0)

    def add(event: str, duration_secs: float, **_: object) -> None:
        if event in _DURATIONS:
            found[_DURATIONS[event]] += duration_secs

    def count(event: str, **_: object) -> None:
        if event in _EVENTS:
            found[_EVENTS[event]] += 1

    jax.monitoring.register_event_duration_secs_listener(add)
    jax.monitoring.register_event_listener(count)
    vx.use_compilation_cache(cache)  # as the command does, before it reads maps
    a, b = vx.read_map(path_a), vx.read_map(path_b)
    seconds, of_first = [], {}
    for _ in range(3):
        start = time.perf_counter()
        vx.register(a, b)
        seconds.append(time.perf_counter() - start)
        of_first = of_first or dict(found)
    again = float(np.median(seconds[1:]))
    return {"kernels ready": seconds[0] - again, **of_first, "register again": again}


def run_process(arguments: list[str], environment: dict[str, str]) -> Run:
    """Run Python with arguments and variables of the environment beside this process's own."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *arguments], env=os.environ | environment, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    output = process.stdout.read()
    if process.wait():
        raise RuntimeError(f"python {' '.join(arguments)} ended with {process.returncode}.")
    return Run(time.perf_counter() - start, output)


def main(argv: list[str]) -> int:
    """Run the benchmark; with two files, measure them in this process and print JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench start", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--rounds", type=round_count, default=5)
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--overlap", type=float, default=0.5)
    parser.add_argument("--tuned", action="store_true", help="also under the tuned allocator")
    parser.add_argument("--in-process", nargs=3, metavar=("MAP", "MAP", "CACHE"), help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.in_process:
        print(json.dumps(measure(*args.in_process)))
        return 0
    print(setting())
    maps = simulate_team(args.seed, overlap=args.overlap, frame="yaw").grids
    print("maps       " + " and ".join(f"{grid.num_occupied:,}" for grid in maps) + " occupied voxels")
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f"{name}.bt") for name in "ab"]
        for path, grid in zip(paths, maps, strict=True):
            vx.write_map(path, grid)
        _report_kernels(paths, str(Path(folder) / "kernels"), args.rounds)
        _report_merge(paths, folder, args.rounds, with_tuned=args.tuned)
    return 0


def _report_kernels(paths: list[str], cache: str, rounds: int, *, most: float = 0.5) -> None:
    """Imports, and kernels in the first and in later processes."""
    program = "import time; start = time.perf_counter(); import voxjax.cli.merge; print(time.perf_counter() - start)"
    imports = [float(run_process(["-c", program], {}).output) for _ in range(rounds)]
    print(f"\nimports of `voxjax merge`: {np.median(imports):.2f} s")
    command = ["-m", "bench", "start", "--in-process", *paths, cache]
    rows = [json.loads(run_process(command, {}).output) for _ in range(1 + rounds)]
    later = {name: float(np.median([row[name] for row in rows[1:]])) for name in rows[0]}
    print("\n| process | " + " | ".join(rows[0]) + " |\n|" + "---|" * (1 + len(rows[0])))
    for name, row in (("first", rows[0]), ("second", later)):
        cells = [f"{row[key]:.0f}" if key in _EVENTS.values() else f"{row[key]:.2f} s" for key in row]
        print(f"| {name} | {' | '.join(cells)} |")
    print(f"\nkernels ready within {most} s: {_verdict(later['kernels ready'] <= most)}")


def _report_merge(paths: list[str], folder: str, rounds: int, *, with_tuned: bool, most: float = 5.0) -> None:
    """The command: the first process, then later ones, the allocators in turns."""
    name, _, value = TUNED.partition("=")
    choices = {"default": {}} | ({"tuned": {name: value}} if with_tuned else {})
    command = ["-m", "voxjax", "merge", *paths, "-o", str(Path(folder) / "fused.bt"), "--force", "-q"]
    # The command's own cache, as a user has it.
    variables = {"XDG_CACHE_HOME": folder, "JAX_COMPILATION_CACHE_DIR": "", "VOXJAX_CACHE": ""}
    first = run_process(command, variables)
    runs: dict[str, list[Run]] = {choice: [] for choice in choices}
    # The order turns round each time, so that neither allocator always comes first.
    for turn in range(rounds):
        for choice in list(choices)[:: 1 if turn % 2 else -1]:
            runs[choice].append(run_process(command, variables | choices[choice]))
    print("\n| `voxjax merge` | allocator | median | least |\n|---|---|---|---|")
    print(f"| first | default | {first.seconds:.2f} s | |")
    for choice, found in runs.items():
        seconds = [run.seconds for run in found]
        print(f"| second | {choice} | {np.median(seconds):.2f} s | {min(seconds):.2f} s |")
    is_met = np.median([run.seconds for run in runs["default"]]) <= most
    print(f"\nsecond merge within {most} s: {_verdict(bool(is_met))}")


def _verdict(is_met: bool) -> str:
    return "met" if is_met else "missed"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
