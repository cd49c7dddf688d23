"""Repeatability of corners between two maps of one place, beside ISS and Harris3D keypoints.

    python -m bench corners [--maps FOLDER] [--only NAME,...] [--generated 6] [--seed 7100] [--out FILE]

Repeatability is the share of the points of one map in the overlap that have a point of the other map within two voxels,
counted both ways; a point lies in the overlap if the other map, put in place by the truth, has an occupied voxel within
five voxels. `chance` is the same
for as many randomly chosen occupied voxels of each map: a detector that finds many points repeats by chance. Maps come
from the folder (or $VOXJAX_MAPS) where there is one, and generated pairs always; seconds are of a warm run.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from bench.cases import folder_cases
from bench.keypoints import harris_keypoints, iss_keypoints, iss_source
from bench.reports import write_json
from bench.timing import setting
from bench.worlds import FRAMES
from voxjax import VoxelGrid, detect_corners
from voxjax.synthetic import simulate_team

SIMULATED = "yaw_20_0,yaw_40_1,tilt_40_0,tilt_65_1,so3_40_0,so3_65_1"
"""The simulated pairs that are taken unless names are given."""


class Pair(NamedTuple):
    """Two maps of one place with the truth `T_a_b`."""

    name: str
    source: str
    load: Callable[[], tuple[VoxelGrid, VoxelGrid, np.ndarray]]


class Count(NamedTuple):
    """Points in the overlap, and those found again; both ways together."""

    num_overlap: int
    num_repeated: int


def generated_pair(seed: int) -> Pair:
    """A pair of one building: frames take turns."""
    frame = FRAMES[seed % 3]

    def load() -> tuple[VoxelGrid, VoxelGrid, np.ndarray]:
        team = simulate_team(seed, frame=frame, drift=0.015, overlap=0.5)
        T_a_b = team.true_pose(0, 1)
        assert T_a_b is not None
        return team.grids[0], team.grids[1], T_a_b

    return Pair(f"generated/{frame}_{seed}", "generated", load)


def pairs_in(root: Path, names: list[str]) -> list[Pair]:
    """Pairs of the folder with a truth; all real ones and some simulated ones unless names are given."""
    found = []
    for case in folder_cases(root, ["sim", "real"]):
        stem = case.name.rsplit("/", 1)[-1]
        wanted = stem in names if names else case.source == "real" or stem in SIMULATED.split(",")
        if case.kind == "none" or not wanted:
            continue

        def load(case=case) -> tuple[VoxelGrid, VoxelGrid, np.ndarray]:
            pair = case.load()
            assert pair.T_a_b is not None
            return pair.a, pair.b, pair.T_a_b

        found.append(Pair(case.name, case.source, load))
    return found


def detect_all(grid: VoxelGrid) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Points [m] and seconds of each detector."""
    start = time.perf_counter()
    corners = detect_corners(grid, virtual=True).trimmed()
    seconds = {"observed + virtual": time.perf_counter() - start}
    position, is_observed = np.asarray(corners.position, np.float64), np.asarray(corners.is_observed)
    points = {
        "observed": position[is_observed],
        "virtual": position[~is_observed],
        "observed + virtual": position,
    }
    for name, detector in (("ISS", iss_keypoints), ("Harris3D", harris_keypoints)):
        start = time.perf_counter()
        points[name] = detector(grid)
        seconds[name] = time.perf_counter() - start
    return points, seconds


def repeated(
    points: np.ndarray,
    others: np.ndarray,
    surface: KDTree,
    voxel: float,
    *,
    reach: float = 5.0,
    tolerance: float = 2.0,
) -> Count:
    """Points in the overlap with a surface, and those of them that have one of the others nearby.

    Args:
        points: Points (n, 3) of one map [m].
        others: Points (m, 3) of the other map [m].
        surface: Occupied voxel centres of the other map.
        voxel: Edge of a voxel [m].
        reach: Largest distance of a point from the surface in the overlap [voxel].
        tolerance: Largest distance of a point from where it is found again [voxel].
    """
    if not len(points):
        return Count(0, 0)
    inside = points[surface.query(points, distance_upper_bound=reach * voxel)[0] <= reach * voxel]
    if not len(inside) or not len(others):
        return Count(len(inside), 0)
    distance = np.asarray(KDTree(others).query(inside)[0])
    return Count(len(inside), int(np.count_nonzero(distance <= tolerance * voxel)))


def both_ways(in_a: np.ndarray, in_b: np.ndarray, a: KDTree, b: KDTree, voxel: float) -> Count:
    """Repetition of the points of a in b and of those of b in a, all in frame a."""
    forth, back = repeated(in_a, in_b, b, voxel), repeated(in_b, in_a, a, voxel)
    return Count(forth.num_overlap + back.num_overlap, forth.num_repeated + back.num_repeated)


def measure(pair: Pair, rng: np.random.Generator) -> list[dict]:
    """Rows of all detectors for one pair."""
    a, b, T_a_b = pair.load()
    detect_all(b)  # compiles
    (points_a, seconds), (points_b, more) = detect_all(a), detect_all(b)
    # The coarser map decides what is near, for no point is placed better than its voxels allow.
    voxel = max(a.voxel_size, b.voxel_size)
    place_a = a.occupied_points().astype(np.float64)
    place_b = _moved(T_a_b, b.occupied_points())
    tree_a, tree_b = KDTree(place_a), KDTree(place_b)
    rows = []
    for name, in_a in points_a.items():
        in_b = _moved(T_a_b, points_b[name])
        count = both_ways(in_a, in_b, tree_a, tree_b, voxel)
        random_a, random_b = _drawn(rng, place_a, len(in_a)), _drawn(rng, place_b, len(in_b))
        chance = both_ways(random_a, random_b, tree_a, tree_b, voxel)
        rows.append(
            {
                "pair": pair.name,
                "source": pair.source,
                "detector": name,
                "points": [len(in_a), len(in_b)],
                "overlap": count.num_overlap,
                "repeated": count.num_repeated,
                "chance_overlap": chance.num_overlap,
                "chance_repeated": chance.num_repeated,
                "seconds": (seconds[name] + more[name]) / 2 if name in seconds else None,
            }
        )
    return rows


def _drawn(rng: np.random.Generator, points: np.ndarray, count: int) -> np.ndarray:
    """A random choice of `count` points, none twice."""
    return points[rng.choice(len(points), min(count, len(points)), replace=False)]


def _moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points under a pose, float64."""
    return points.astype(np.float64) @ T[:3, :3].T + T[:3, 3]


def table(rows: list[dict]) -> list[str]:
    """Markdown: one row a source and detector, points of all its pairs together."""
    lines = [
        "| maps | detector | points a map | in the overlap | repeatability | chance | s a map |",
        "|---|---|---|---|---|---|---|",
    ]
    for source in dict.fromkeys(row["source"] for row in rows):
        mine = [row for row in rows if row["source"] == source]
        num_pairs = len({row["pair"] for row in mine})
        for detector in dict.fromkeys(row["detector"] for row in mine):
            some = [row for row in mine if row["detector"] == detector]
            points = np.mean([row["points"] for row in some])
            timed = [row["seconds"] for row in some if row["seconds"] is not None]
            seconds = f"{np.median(timed):.2f}" if timed else ""
            overlap = sum(row["overlap"] for row in some)
            lines.append(
                f"| {source} ({num_pairs} pairs) | {detector} | {points:.0f} | {overlap} | {_share(some, '')} "
                f"| {_share(some, 'chance_')} | {seconds} |"
            )
    return lines


def _share(rows: list[dict], prefix: str) -> str:
    """Share of the points in the overlap that are repeated, in per cent."""
    overlap = sum(row[f"{prefix}overlap"] for row in rows)
    return f"{100 * sum(row[f'{prefix}repeated'] for row in rows) / overlap:.0f} %" if overlap else "-"


def main(argv: list[str]) -> int:
    """Print a line a pair and the table, write both as JSON."""
    parser = argparse.ArgumentParser(
        prog="bench corners", description="Repeatability of corners and keypoints."
    )
    parser.add_argument("--maps", default=os.environ.get("VOXJAX_MAPS"), help="folder with real/ and sim/")
    parser.add_argument("--only", default="", help="names of pairs of the folder")
    parser.add_argument("--generated", type=int, default=6, help="number of generated pairs")
    parser.add_argument("--seed", type=int, default=7100, help="seed of the first generated pair")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "out" / "corners.json")
    options = parser.parse_args(argv)
    print(setting(), f"ISS        {iss_source()}", sep="\n", end="\n\n", flush=True)
    names = [name for name in options.only.split(",") if name]
    pairs = pairs_in(Path(options.maps), names) if options.maps else []
    pairs += [generated_pair(options.seed + number) for number in range(options.generated)]
    if not pairs:
        parser.error("there are no pairs; give --maps or --generated")
    rows: list[dict] = []
    for number, pair in enumerate(pairs):
        mine = measure(pair, np.random.default_rng([options.seed, number]))
        rows += mine
        cells = ", ".join(
            f"{row['detector']} {_share([row], '')} (chance {_share([row], 'chance_')})" for row in mine
        )
        print(f"{pair.name}: {cells}", flush=True)
    print("", *table(rows), sep="\n")
    write_json(options.out, {"setting": setting(), "iss": iss_source(), "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
