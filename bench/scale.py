"""Maps as they come: frames far from zero, strays far away, outdoor clouds, fragments in fine voxels.

    python -m bench scale [--maps FOLDER] [--seed S] [--quick] [--only PART ...]

Frames: a generated pair at zero and in the coordinates of a national grid. Strays: the same pair as files, with and
without one occupied voxel 600 m away, and as clouds of points, with and without one 10 km away; read and registered
in processes of their own (seconds of the second call, peak of the resident set). Clouds and fragments are the real
pairs of the folder of test maps that have no free space: seconds of features and of the exhaustive search in the
second call, and errors at the working voxel size, at the files' own, and at 0.1 m, which finer maps were brought to
before. Outdoors: clouds of a generated site. Valleys: rolling ground with houses and trees in voxels of 0.5 to 2 m, a
kind of place on which nothing was chosen. Boxes: the same two buildings, ever farther apart. Site: two maps of a
hillside with nine buildings, merged at their own resolution by the command, in a process of its own.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.cases import Case, folder_cases, maps_folder
from bench.memory import peak_megabytes
from bench.reports import markdown_table, write_json
from bench.scale_sites import box_rows, site_cloud_row, site_row
from bench.sites import Site
from bench.timing import setting
from bench.valleys import valley_rows
from bench.worlds import MapPair
from voxjax.frames import from_local
from voxjax.metrics import pose_error
from voxjax.synthetic import simulate_team

FAR = np.array([4e5, 5e6, 3e2])
"""Easting, northing and height of a far frame [m]: whole voxels of 0.1 m."""
STRAY, CLOUD_STRAY = 600.0, 10_000.0
"""How far away the stray voxel of a map, and the stray point of a cloud, lies [m]."""
PARTS = ("frames", "strays", "outdoors", "valleys", "boxes", "site", "clouds")


def frame_row(a: vx.VoxelGrid, b: vx.VoxelGrid) -> dict:
    """Merge a pair near zero and far out, and compare."""

    def far(grid: vx.VoxelGrid) -> vx.VoxelGrid:
        return vx.VoxelGrid(grid.states, np.asarray(grid.origin) + FAR, grid.voxel_size, grid.log_odds)

    near, there = vx.merge([a, b]), vx.merge([far(a), far(b)])
    point = b.occupied_points().mean(axis=0)
    found, expected = (merged.pairs[0][2] for merged in (there, near))
    gap = pose_error(found.T_a_b, from_local(np.asarray(expected.T_a_b), FAR, FAR), point + FAR)
    same = (
        near.grid is not None
        and there.grid is not None
        and np.array_equal(np.asarray(near.grid.states), np.asarray(there.grid.states))
    )
    return {
        "verdict near": expected.verdict,
        "verdict far": found.verdict,
        "gap [mm]": 1e3 * gap.metres,
        "same states": bool(same),
    }


def with_stray(grid: vx.VoxelGrid) -> vx.VoxelGrid:
    """The map with one occupied voxel far away along x."""
    states = np.zeros((grid.shape[0] + round(STRAY / grid.voxel_size), *grid.shape[1:]), np.uint8)
    states[: grid.shape[0]] = grid.states
    states[-1, 0, 0] = 2
    return vx.VoxelGrid(states, grid.origin, grid.voxel_size)


def measure(path_a: str, path_b: str) -> dict:
    """Read and register two maps twice in this process; seconds of the second time, and the peak [MB]."""
    for _ in range(2):
        start = time.perf_counter()
        grids = vx.read_map(path_a), vx.read_map(path_b)
        found = vx.register(*grids)
        seconds = time.perf_counter() - start
    return {
        "seconds": seconds,
        "peak [MB]": peak_megabytes(),
        "verdict": found.verdict,
        "T_a_b": np.asarray(found.T_a_b).tolist(),
    }


def stray_rows(a: vx.VoxelGrid, b: vx.VoxelGrid) -> Iterator[dict]:
    """Cost of a pair without and with a stray in the first map, as maps with free space and as clouds."""
    clouds = [vx.VoxelGrid.from_points(each.occupied_points(), voxel_size=each.voxel_size) for each in (a, b)]
    points = np.concatenate([a.occupied_points(), a.occupied_points()[-1:] + [CLOUD_STRAY, 0.0, 0.0]])
    stray_cloud = vx.VoxelGrid.from_points(points, voxel_size=a.voxel_size)
    with tempfile.TemporaryDirectory() as folder:
        for ending, one, stray, other, name, distance in (
            ("bt", a, with_stray(a), b, "maps", STRAY),
            ("ply", clouds[0], stray_cloud, clouds[1], "clouds", CLOUD_STRAY),
        ):
            paths = [str(Path(folder) / f"{part}.{ending}") for part in ("a", "stray", "b")]
            for path, grid in zip(paths, (one, stray, other), strict=True):
                vx.write_map(path, grid)
            for path, kind in zip(paths, ("as they are", f"a stray at {distance:g} m"), strict=False):
                command = [sys.executable, "-m", "bench", "scale", "--in-process", path, paths[2]]
                done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
                found = json.loads(done.stdout)
                del found["T_a_b"]
                yield {"maps": f"{name}, {kind}"} | found


def cloud_row(case: Case, pair: MapPair) -> dict:
    """Errors of a real pair without free space at three voxel sizes, and seconds at the working one."""
    own = max(pair.a.voxel_size, pair.b.voxel_size)
    row: dict = {"pair": case.name, "occupied": f"{pair.a.num_occupied} / {pair.b.num_occupied}"}
    for name, settings in (
        ("", {}),
        ("own ", {"voxel_size": own}),
        ("0.1 m ", {"voxel_size": max(own, 0.1)}),
    ):
        for _ in range(1 if name else 2):
            found = vx.register(pair.a, pair.b, config={"map": settings})
        judged = case.judge([np.asarray(found.T_a_b)], pair.T_a_b, pair.centroid_of_b)
        mark = "right" if judged["right"] else "wrong"
        row[f"{name}pose"] = f"{mark}, {judged['metres']:.3f} m, {judged['degrees']:.1f} deg"
        if not name:
            seconds = found.stats["seconds"]
            row |= {
                "voxel [m]": found.stats["voxel_size"],
                "verdict": found.verdict,
                "features [s]": seconds["features"],
                "exhaustive [s]": seconds["exhaustive search"],
                "all [s]": sum(seconds.values()),
            }
    return row


def table(rows: list[dict]) -> str:
    """Rows as a Markdown table."""
    cells = [[f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    return markdown_table(list(rows[0]), cells)


def main(argv: list[str]) -> int:
    """Print a table for each part and write JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench scale", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--maps", type=Path, help="folder of test maps; default: VOXJAX_MAPS or ../shared/maps"
    )
    parser.add_argument("--seed", type=int, default=70)
    parser.add_argument("--quick", action="store_true", help="generated maps alone, in voxels of 0.2 m")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to run; default: all")
    parser.add_argument("--out", type=Path, default=Path("bench/out/scale.json"))
    parser.add_argument("--in-process", nargs=2, metavar="MAP", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.in_process:
        print(json.dumps(measure(*args.in_process)))
        return 0
    print(setting(), flush=True)
    parts = {}
    with tempfile.TemporaryDirectory() as temporary:
        for name in (part for part in PARTS if part in args.only):
            rows = list(_rows_of(name, args, Path(temporary)))
            if rows:
                parts[name] = rows
                print(f"\n{name}\n\n{table(rows)}", flush=True)
    write_json(args.out, parts)
    return 0


def _rows_of(name: str, args: argparse.Namespace, temporary: Path) -> Iterator[dict]:
    """The rows of a part; none of the larger ones where only quick ones are wanted."""
    voxel_size = 0.2 if args.quick else 0.1
    if name in ("frames", "strays"):
        a, b = simulate_team(args.seed, overlap=0.4, frame="yaw", voxel_size=voxel_size).grids[:2]
        yield from [frame_row(a, b)] if name == "frames" else stray_rows(a, b)
    elif name == "outdoors":
        yield site_cloud_row(args.seed)
    elif name == "valleys":
        yield from valley_rows(args.seed, (1.0,) if args.quick else (0.5, 1.0, 2.0))
    elif name == "boxes":
        yield from box_rows(args.seed, voxel_size, temporary)
    elif name == "site" and not args.quick:
        yield site_row(args.seed, Site(), temporary)
    elif name == "clouds":
        folder = maps_folder(args.maps, is_wanted=not args.quick)
        for case in folder_cases(folder, ["real"]) if folder else []:
            pair = case.load()
            if not pair.a.num_free:
                yield cloud_row(case, pair)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
