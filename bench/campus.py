"""A generated campus in Zarr stores: features, registration and fusion, each in a process of its own.

    python -m bench campus [--size small] [--size large] [--seed S] [--keep FOLDER] [--step NAME ...]

Two maps that share a third of a campus of 4096 x 4096 x 128 (small) or 16384 x 16384 x 256 voxels of 0.1 m are
generated into stores, shard by shard (`campus_maps.py`). Printed for each step: seconds on the clock and of this
process, and the peak of the resident set; for fusion into a store by 1, 2 and 4 processes the peak of the largest one,
and voxels of the fused box per second. The last step is the command `voxjax merge --memory 2G -o map.zarr`: its exit
code, its peak, and what it says.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.campus_maps import Campus, write_campus
from bench.memory import peak_megabytes
from bench.reports import write_json
from bench.timing import setting
from voxjax.metrics import pose_error
from voxjax.pipeline.features import features_at

SIZES = {
    "small": Campus((4096, 4096, 128), num_buildings=12, num_kinds=6, num_roads=2),
    "large": Campus((16384, 16384, 256), num_buildings=36, num_kinds=6, num_roads=2),
}
STEPS = ("features", "register", "fuse 1", "fuse 2", "fuse 4", "merge")


def measure(step: str, folder: Path, size: str, seed: int) -> dict:
    """Do one step in this process."""
    if step == "generate":
        return _generate(folder, size, seed)
    grids = [vx.read_map(folder / name) for name in ("a.zarr", "b.zarr")]
    truth = np.asarray(json.loads((folder / "truth.json").read_text()))
    if step == "features":
        return _timed(lambda: features_at(grids[0], voxel_size=grids[0].voxel_size) and {})
    if step == "register":
        return _timed(lambda: _registered(grids, truth))
    number = int(step.split()[1])

    def fuse() -> dict:
        fused = vx.fuse(grids, [np.eye(4), truth], out=folder / "fused.zarr", num_processes=number)
        return {"box": list(fused.shape), "voxels": fused.num_voxels}

    row = _timed(fuse)
    # Children that were waited for; the kernel counts kilobytes.
    child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1.024e-3
    return row | {
        "million voxels per second": row.pop("voxels") / row["seconds"] / 1e6,
        "peak [MB]": row["peak [MB]"] if number == 1 else max(child, row["peak [MB]"]),
    }


def _timed(work: Callable[[], dict]) -> dict:
    """Seconds on the clock and of the processor, the peak, and what the work tells."""
    start, busy = time.perf_counter(), time.process_time()
    found = work()
    seconds = time.perf_counter() - start
    row = {"seconds": seconds, "cpu [s]": time.process_time() - busy, "peak [MB]": peak_megabytes()}
    return row | found


def _generate(folder: Path, size: str, seed: int) -> dict:
    """Write the maps and the true pose."""

    def write() -> dict:
        truth = write_campus(seed, SIZES[size], folder)
        (folder / "truth.json").write_text(json.dumps(truth.tolist()))
        return {}

    row = _timed(write)
    for name in ("a", "b"):
        grid = vx.read_map(folder / f"{name}.zarr")
        files = [path for path in (folder / f"{name}.zarr").rglob("*") if path.is_file()]
        row[name] = {
            "box": list(grid.shape),
            "occupied": grid.num_occupied,
            "free": grid.num_free,
            "chunks": len(grid.cubes(64)),
            "MB on disk": sum(path.stat().st_size for path in files) / 1e6,
        }
    return row


def _registered(grids: list[vx.VoxelGrid], truth: np.ndarray) -> dict:
    """Register both maps, and compare with the truth about the middle of the second."""
    found = vx.register(*grids)
    low, high = grids[1].extent
    error = pose_error(np.asarray(found.T_a_b), truth, (np.asarray(low) + high) / 2)
    return {
        "verdict": found.verdict,
        "confidence": found.confidence,
        "metres": error.metres,
        "degrees": error.degrees,
        "of stages": found.stats["seconds"],
    }


def merged_by_command(folder: Path) -> dict:
    """`voxjax merge` with two gigabytes granted."""
    code = (
        "import sys; from bench.memory import peak_megabytes; from voxjax.cli.main import main; "
        "code = main(sys.argv[1:]); print(f'\\n{peak_megabytes()}'); sys.exit(code)"
    )
    arguments = ["merge", *(str(folder / name) for name in ("a.zarr", "b.zarr"))]
    arguments += ["-o", str(folder / "merged.zarr"), "--memory", "2G", "--force", "-q"]
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    return {
        "seconds": time.perf_counter() - start,
        "peak [MB]": float(done.stdout.splitlines()[-1]),
        "exit code": done.returncode,
        "says": done.stderr.strip().splitlines()[-1:],
    }


def step_row(step: str, folder: Path, size: str, seed: int) -> dict:
    """One step in a process of its own; what that says where it fails."""
    if step == "merge":
        return merged_by_command(folder)
    command = [sys.executable, "-m", "bench", "campus", "--in-process", step, "--keep", str(folder)]
    command += ["--size", size, "--seed", str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"exit code": done.returncode, "says": done.stderr.strip().splitlines()[-1:]}
    return json.loads(done.stdout.splitlines()[-1])


def main(argv: list[str]) -> int:
    """Print a line for each step and write JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench campus", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--size", action="append", choices=SIZES, help="again for several (default: small)")
    parser.add_argument("--step", action="append", choices=STEPS, help="again for several (default: all)")
    parser.add_argument("--seed", type=int, default=80)
    parser.add_argument("--keep", type=Path, help="folder where the stores are, or are written and stay")
    parser.add_argument("--out", type=Path, default=Path("bench/out/campus.json"))
    parser.add_argument("--in-process", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    sizes = args.size or ["small"]
    if args.in_process:
        print(json.dumps(measure(args.in_process, args.keep, sizes[0], args.seed)))
        return 0
    print(setting(), flush=True)
    rows: dict[str, dict] = {}
    for size in sizes:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) if args.keep is None else args.keep / size
            folder.mkdir(parents=True, exist_ok=True)
            is_there = (folder / "truth.json").exists()
            for step in ([] if is_there else ["generate"]) + (args.step or list(STEPS)):
                rows[f"{size}, {step}"] = row = step_row(step, folder, size, args.seed)
                print(f"{size}, {step}: {json.dumps(row)}", flush=True)
    write_json(args.out, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
