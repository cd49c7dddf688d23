"""Parts of the benchmark of maps as they come that have large boxes: a site, and one surface in ever larger boxes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.sites import Site, paste, simulate_site
from bench.worlds import MapPair
from voxjax.metrics import pose_error
from voxjax.synthetic import simulate_team


def site_row(seed: int, site: Site, folder: Path) -> dict:
    """Merge two maps of a site by the command, in a process of its own.

    Args:
        seed: Decides what is generated.
        site: How large it is.
        folder: Where the maps go.
    """
    pair = simulate_site(seed, site)
    assert pair.T_a_b is not None
    paths = {name: str(folder / name) for name in ("a.bt", "b.bt", "out.bt", "report.json")}
    for name, grid in (("a.bt", pair.a), ("b.bt", pair.b)):
        vx.write_map(paths[name], grid)
    merge = [
        "merge",
        paths["a.bt"],
        paths["b.bt"],
        "-o",
        paths["out.bt"],
        "--report",
        paths["report.json"],
        "-q",
    ]
    seconds, peak, code = _command(merge)
    row = {
        "site": " x ".join(f"{side / site.voxel_size:.0f}" for side in site.sides),
        "occupied": f"{pair.a.num_occupied} / {pair.b.num_occupied}",
        "files [MB]": sum(os.path.getsize(paths[name]) for name in ("a.bt", "b.bt")) / 1e6,
        "exit code": code,
        "command [s]": seconds,
        "peak [MB]": peak,
    }
    report = json.loads(Path(paths["report.json"]).read_text())["pairs"][0]
    error = pose_error(np.asarray(report["T_a_b"]), pair.T_a_b, pair.centroid_of_b)
    row |= {"metres": error.metres, "degrees": error.degrees, "confidence": report["confidence"]}
    return row | {f"{name} [s]": value for name, value in report["seconds"].items()}


def _command(arguments: list[str]) -> tuple[float, float, int]:
    """Seconds, peak [MB] and exit code of a `voxjax` command."""
    code = (
        "import sys; from bench.memory import peak_megabytes; from voxjax.cli.main import main; "
        "code = main(sys.argv[1:]); print(f'\\n{peak_megabytes()}'); sys.exit(code)"
    )
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, text=True, check=False
    )
    return time.perf_counter() - start, float(done.stdout.splitlines()[-1]), done.returncode


def box_rows(seed: int, voxel_size: float, folder: Path) -> Iterator[dict]:
    """Cost of reading and registering two maps of two buildings that stand ever farther apart.

    Args:
        seed: Decides what is generated.
        voxel_size: Width of a voxel [m].
        folder: Where the maps go.
    """
    paths = [str(folder / name) for name in ("a.bt", "b.bt")]
    for factor in (1, 10, 100, 1000):
        pair = apart(seed, factor, voxel_size)
        for path, grid in zip(paths, (pair.a, pair.b), strict=True):
            vx.write_map(path, grid)
        command = [sys.executable, "-m", "bench", "scale", "--in-process", *paths]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        found = json.loads(done.stdout)
        assert pair.T_a_b is not None
        error = pose_error(np.asarray(found.pop("T_a_b")), pair.T_a_b, pair.centroid_of_b)
        box = " x ".join(map(str, pair.a.shape))
        yield {"volume": factor, "box of a [voxel]": box} | found | {"metres": error.metres}


def cloud_of_site(seed: int) -> MapPair:
    """Two maps of a small site as clouds have it: surfaces alone, in voxels of 0.7 m."""
    pair = simulate_site(seed, Site(sides=(113.0, 117.0, 17.0), num_buildings=6, voxel_size=0.7))
    a, b = (
        vx.VoxelGrid(np.where(grid.states == 2, 2, 0).astype(np.uint8), grid.origin, grid.voxel_size)
        for grid in (pair.a, pair.b)
    )
    return MapPair(a, b, pair.T_a_b, pair.overlap)


def site_cloud_row(seed: int) -> dict:
    """Register two clouds of a small site twice; seconds of the second time."""
    pair = cloud_of_site(seed)
    assert pair.T_a_b is not None
    found = [vx.register(pair.a, pair.b) for _ in range(2)][-1]
    error, seconds = (
        pose_error(np.asarray(found.T_a_b), pair.T_a_b, pair.centroid_of_b),
        found.stats["seconds"],
    )
    return {
        "box of a [voxel]": " x ".join(map(str, pair.a.shape)),
        "occupied": f"{pair.a.num_occupied} / {pair.b.num_occupied}",
        "verdict": found.verdict,
        "metres": error.metres,
        "features [s]": seconds["features"],
        "exhaustive [s]": seconds["exhaustive search"],
        "all [s]": sum(seconds.values()),
    }


def apart(seed: int, factor: float, voxel_size: float) -> MapPair:
    """Two maps of two buildings each, in a box that has about `factor` times the volume of both side by side.

    Args:
        seed: Decides what is generated.
        factor: At least 1.
        voxel_size: Width of a voxel [m].
    """
    # Side by side two buildings fill a box of about 60 x 40 x 5 m, which grows alike along all axes.
    step = np.array([60.0, 40.0, 5.0]) * factor ** (1 / 3) - (30.0, 40.0, 5.0)
    T_a_b = np.eye(4)
    T_a_b[:3, :3], T_a_b[:3, 3] = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix(), (3.0, -2.0, 1.0)
    frames, maps = (np.eye(4), T_a_b), ([], [])
    for number in range(2):
        team = simulate_team(seed + number, overlap=0.6, frame="yaw", voxel_size=voxel_size)
        for which, (grid, T_world_map) in enumerate(zip(team.grids, team.poses, strict=True)):
            T = np.array(T_world_map, np.float64)
            T[:3, 3] += number * step
            maps[which].append(grid.transformed(np.linalg.inv(frames[which]) @ T))
    return MapPair(paste(maps[0]), paste(maps[1]), T_a_b, overlap=0.6)
