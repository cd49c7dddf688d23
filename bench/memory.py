"""Peak memory of `voxjax.register` and `voxjax.fuse`, in processes of their own, against what is estimated beforehand.

    python -m bench memory [--seed S] [--quick]

Generates pairs of maps: of one building in frames that differ by yaw or in any way (the blocks around tilted maps are
mostly unknown voxels), at voxels of 0.2, 0.1 and 0.05 m, and of different buildings, which go through all sources of
hypotheses. Each pair is registered at its own voxel size in a fresh process without kept kernels, once and three times,
and fused. Prints what the resident set grew by from reading the maps on, and the estimate of
`voxjax.pipeline.memory_need` that a pair is refused by.

Takes about 2 minutes with `--quick`, on two cores.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import voxjax as vx
from bench.timing import setting
from voxjax.pipeline.memory_need import content_size, register_memory
from voxjax.synthetic import simulate_team

_CALLS = 3
"""How often each pair is registered in one process."""


def peak_megabytes() -> float:
    """Largest resident set of this process so far [MB]."""
    status = Path("/proc/self/status")
    if status.exists():
        # Linux hands the largest set of the process that started this one on in `ru_maxrss`.
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1.024e-3
    unit = 1e-3 if sys.platform == "darwin" else 1.0  # macOS counts bytes, others kilobytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit * 1.024e-3


def measure(path_a: str, path_b: str) -> dict:
    """Read, register and fuse two maps, and note the peak after each step [MB]."""
    grids = vx.read_map(path_a), vx.read_map(path_b)
    size = grids[0].voxel_size
    sizes = [content_size(grid) for grid in grids]
    row: dict = {
        "million voxels": sum(grid.num_voxels for grid in grids) / 1e6,
        "thousand occupied": sum(grid.num_occupied for grid in grids) / 1e3,
        "estimate": register_memory(sizes, size) / 1e6,
        "read": peak_megabytes(),
    }
    for call in range(_CALLS):
        found = vx.register(*grids, config={"map": {"voxel_size": size}})
        row[f"call {call + 1}"] = peak_megabytes()
    fused = vx.fuse(grids, [[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], found.T_a_b])
    return row | {
        "fuse": peak_megabytes(),
        "fused": fused.num_voxels / 1e6,
        "verdict": found.verdict,
        "rounds": found.stats["num_rounds"],
    }


def pairs(seed: int, *, quick: bool) -> Iterator[tuple[str, Sequence[vx.VoxelGrid]]]:
    """Pairs of maps with a name, made one after the other."""
    for frame in ("yaw",) if quick else ("yaw", "so3"):
        for voxel_size in (0.2, 0.1) if quick else (0.2, 0.1, 0.05):
            team = simulate_team(seed, overlap=0.3, frame=frame, voxel_size=voxel_size)
            yield f"one building, {frame}, {voxel_size:g} m", team.grids
    grids = [simulate_team(seed + k, overlap=0.3, frame="yaw").grids[k] for k in range(2)]
    yield "different buildings, 0.1 m", grids


def main(argv: list[str]) -> int:
    """Run the benchmark; with two files, measure them in this process and print JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench memory", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=50)
    parser.add_argument("--quick", action="store_true", help="three pairs instead of seven")
    parser.add_argument("--in-process", nargs=2, metavar="MAP", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.in_process:
        print(json.dumps(measure(*args.in_process)))
        return 0
    print(setting())
    print(
        "| pair | voxels | occupied | with the maps read | one call | three calls | estimate | of one call | "
        "fused voxels | fused |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(folder) / f"{which}.npz") for which in "ab"]
        for name, grids in pairs(args.seed, quick=args.quick):
            for path, grid in zip(paths, grids, strict=True):
                vx.write_map(path, grid)
            command = [sys.executable, "-m", "bench", "memory", "--in-process", *paths]
            done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
            print(_line(name, json.loads(done.stdout)), flush=True)
    return 0


def _line(name: str, row: dict) -> str:
    """A row of the table; peaks from reading on [MB]."""
    base = row["read"]
    calls = [row[f"call {call}"] - base for call in (1, _CALLS)]
    return (
        f"| {name}, {row['verdict']}, {row['rounds']} rounds | {row['million voxels']:.1f} M | "
        f"{row['thousand occupied']:.0f} k | {base:.0f} MB | +{calls[0]:.0f} MB | +{calls[1]:.0f} MB | "
        f"{row['estimate']:.0f} MB | {row['estimate'] / calls[0]:.2f} | {row['fused']:.1f} M | "
        f"+{row['fuse'] - base:.0f} MB |"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
