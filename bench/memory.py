"""Peak memory of `voxjax.register`, in processes of their own.

    python -m bench memory [--seed S] [--overlap SHARE]

Generates two maps of about 100,000 occupied voxels of one building and two of different buildings, which go through
all sources of hypotheses, and registers each pair in a fresh process: once, and three times. Prints the peak of the
resident set, Python and all libraries included, and what of it came with reading the maps and with registering them.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import voxjax as vx
from bench.timing import setting
from voxjax.synthetic import simulate_team

_KILOBYTES = 1000.0 if sys.platform == "darwin" else 1.0
_CALLS = 3


def peak_megabytes() -> float:
    """Largest resident set of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _KILOBYTES * 1.024e-3


def measure(path_a: str, path_b: str) -> dict:
    """Read and register two maps, and note the peak after each step [MB]."""
    a, b = vx.read_map(path_a), vx.read_map(path_b)
    row = {"occupied": [a.num_occupied, b.num_occupied], "read": peak_megabytes()}
    for call in range(_CALLS):
        found = vx.register(a, b)
        row[f"call {call + 1}"] = peak_megabytes()
    return row | {"verdict": found.verdict, "rounds": found.stats["num_rounds"]}


def main(argv: list[str]) -> int:
    """Run the benchmark; with two files, measure them in this process and print JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench memory", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--overlap", type=float, default=0.3)
    parser.add_argument("--in-process", nargs=2, metavar="MAP", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.in_process:
        print(json.dumps(measure(*args.in_process)))
        return 0
    print(setting())
    maps = [simulate_team(args.seed + k, overlap=args.overlap, frame="yaw").grids for k in range(2)]
    print(
        "| pair | occupied voxels | after reading | after one call | after three calls [MB] |\n|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, (a, b) in {
            "one building": maps[0],
            "different buildings": (maps[0][0], maps[1][1]),
        }.items():
            paths = [str(Path(folder) / f"{which}.npz") for which in "ab"]
            for path, grid in zip(paths, (a, b), strict=True):
                vx.write_map(path, grid)
            command = [sys.executable, "-m", "bench", "memory", "--in-process", *paths]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            row = json.loads(done.stdout)
            counts = " and ".join(f"{n:,}" for n in row["occupied"])
            print(
                f"| {name}, {row['rounds']} rounds, {row['verdict']} | {counts} | {row['read']:.0f} | "
                f"{row['call 1']:.0f} | {row[f'call {_CALLS}']:.0f} |"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
