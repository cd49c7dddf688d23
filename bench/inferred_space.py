"""How much of the free space that is inferred for clouds had been seen to be free, and how much of that is inferred.

    python -m bench inferred_space [--maps FOLDER] [--count 6] [--seed 400000]

Takes all free space from generated maps and from those real maps that have some, infers it from what encloses it
(`maps/inferred_space.py`), and compares: precision is the share of the inferred voxels that the sensor had seen
to be free (the others are unknown), recall the share of the free voxels that are inferred.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.calibration_worlds import load_world, seeds_of, without_free_space
from bench.cases import maps_folder
from bench.reports import write_json
from bench.timing import setting
from voxjax.maps.inferred_space import infer_free_space


def maps(args: argparse.Namespace) -> Iterator[tuple[str, vx.VoxelGrid]]:
    """Named maps that have free space."""
    for seed in seeds_of("build", args.count, args.seed):
        (grid,), _ = load_world(seed, "build", args.cache)
        yield f"generated {seed}", grid
    folder = maps_folder(args.maps)
    for truth in sorted((folder / "real").glob("*/truth.json")) if folder else ():
        for name in ("a.bt", "b.bt"):
            if (truth.parent / name).exists():
                yield f"{truth.parent.name}/{name}", vx.read_map(truth.parent / name)


def main(argv: list[str]) -> int:
    """Print a line for each map and write JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench inferred_space",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument(
        "--maps", type=Path, help="folder of test maps; default: VOXJAX_MAPS or ../shared/maps"
    )
    parser.add_argument("--count", type=int, default=6, help="generated maps")
    parser.add_argument("--seed", type=int, default=400_000)
    parser.add_argument("--cache", type=Path, default=None, help="folder for generated maps")
    parser.add_argument("--out", type=Path, default=Path("bench/out/inferred_space.json"))
    args = parser.parse_args(argv)
    print(setting() + "\n| map | voxels | precision | recall | seconds |\n|---|---|---|---|---|")
    rows = []
    for name, grid in maps(args):
        states = np.asarray(grid.states)
        cloud = without_free_space(grid)
        start = time.perf_counter()
        inferred = np.asarray(infer_free_space(cloud).states) == 1
        seconds = time.perf_counter() - start
        is_free = states == 1
        both = int((inferred & is_free).sum())
        row = {
            "name": name,
            "voxels": states.size,
            "seconds": seconds,
            "precision": both / max(int(inferred.sum()), 1),
            "recall": both / max(int(is_free.sum()), 1),
        }
        rows.append(row)
        print(
            f"| {name} | {states.size:,} | {row['precision']:.3f} | {row['recall']:.2f} | {seconds:.2f} |",
            flush=True,
        )
    write_json(args.out, {"rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
