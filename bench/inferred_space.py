"""How much of the free space that is inferred for clouds had been seen to be free, and how much of that is inferred.

    python -m bench inferred_space [--maps FOLDER] [--count 6] [--seed 400000] [--rounds 7]

Takes all free space from generated maps and from those real maps that have some, infers it from what encloses it
(`maps/inferred_space.py`), and compares: precision is the share of the inferred voxels that the sensor had seen
to be free (the others are unknown), recall the share of the free voxels that are inferred.

A second table has the real clouds, and those maps without their free space: warm medians of inferring and of all
features, and whether enough is inferred to be used.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.calibration_worlds import load_world, seeds_of, without_free_space
from bench.cases import maps_folder
from bench.reports import write_json
from bench.timing import round_count, setting, time_interleaved
from voxjax.maps.inferred_space import infer_free_space
from voxjax.pipeline.features import features_at


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


def clouds(args: argparse.Namespace) -> Iterator[tuple[str, vx.VoxelGrid]]:
    """Named maps without free space: the real clouds, then the other maps stripped of it."""
    folder = maps_folder(args.maps)
    for truth in sorted((folder / "real").glob("*/truth.json")) if folder else ():
        voxel_size = json.loads(truth.read_text(encoding="utf-8"))["resolution"]
        for name in ("a.ply", "b.ply"):
            if (truth.parent / name).exists():
                yield (
                    f"{truth.parent.name}/{name}",
                    vx.read_map(truth.parent / name, voxel_size=voxel_size),
                )
    for name, grid in maps(args):
        yield name, without_free_space(grid)


def compared(grid: vx.VoxelGrid) -> dict[str, float]:
    """How much of a map's free space is inferred, and how much of what is inferred was seen to be free."""
    inferred = np.asarray(infer_free_space(without_free_space(grid)).states) == 1
    is_free = np.asarray(grid.states) == 1
    both = int((inferred & is_free).sum())
    return {
        "voxels": is_free.size,
        "precision": both / max(int(inferred.sum()), 1),
        "recall": both / max(int(is_free.sum()), 1),
    }


def timed(grid: vx.VoxelGrid, rounds: int) -> dict[str, float | str]:
    """Warm medians of inferring and of all features at the map's own voxel size, and what the features use."""
    times = time_interleaved(
        {
            "infer": lambda: infer_free_space(grid),
            "features": lambda: features_at(grid, voxel_size=grid.voxel_size).prepared.points,
        },
        rounds=rounds,
    )
    features = features_at(grid, voxel_size=grid.voxel_size)
    return {
        "voxels": int(np.prod(grid.shape)),
        "occupied": grid.num_occupied,
        "free_space": features.free_space,
        **{f"{time.name}_s": time.median_s for time in times},
    }


def main(argv: list[str]) -> int:
    """Print a line for each map and write JSON."""
    args = arguments(argv)
    print(setting() + "\n| map | voxels | precision | recall |\n|---|---|---|---|")
    rows, times = [], []
    for name, grid in maps(args):
        rows.append(row := {"name": name, **compared(grid)})
        print(f"| {name} | {row['voxels']:,} | {row['precision']:.3f} | {row['recall']:.2f} |", flush=True)
    print("\n| cloud | voxels | occupied | free space | inferring | features |\n|---|---|---|---|---|---|")
    for name, grid in clouds(args):
        times.append(row := {"name": name, **timed(grid, args.rounds)})
        print(
            f"| {name} | {row['voxels']:,} | {row['occupied']:,} | {row['free_space']} "
            f"| {row['infer_s']:.3f} s | {row['features_s']:.3f} s |",
            flush=True,
        )
    write_json(args.out, {"rows": rows, "clouds": times})
    return 0


def arguments(argv: list[str]) -> argparse.Namespace:
    """What the command line asks for."""
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
    parser.add_argument("--rounds", type=round_count, default=7, help="timed calls of each function")
    parser.add_argument("--cache", type=Path, default=None, help="folder for generated maps")
    parser.add_argument("--out", type=Path, default=Path("bench/out/inferred_space.json"))
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
