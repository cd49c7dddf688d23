"""Hypotheses from local descriptors on test maps, beside KISS-Matcher on the same points.

    python -m bench descriptors [--maps FOLDER] [--only NAME,...] [--no-peer]

A hypothesis counts as found when it is within 10 degrees and 1 m (at map b's centroid) of the truth: refinement
takes it from there. Seconds are of a second, warm run; both sides get the occupied voxel centres and the same
working voxel. The rank of the right hypothesis counts from 0.

Takes about a minute, on two cores.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.peers import Peer, load_peers
from bench.timing import setting
from voxjax.matching.descriptors import describe_map, finest_level, working_spacing
from voxjax.metrics import PoseError, pose_error
from voxjax.registration.hypotheses.descriptors import descriptor_hypotheses

SIMULATED = "yaw_20_0,yaw_40_0,tilt_20_1,tilt_65_0,so3_20_0,so3_40_1,so3_65_0,hotel_0"
"""One simulated pair of each kind and overlap, or nearly."""


def main(argv: list[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="bench descriptors", description=__doc__)
    parser.add_argument("--maps", default=os.environ.get("VOXJAX_MAPS"), help="folder with real/ and sim/")
    parser.add_argument("--only", help=f"names of pairs; default: all of real/, and of sim/ {SIMULATED}")
    parser.add_argument("--no-peer", action="store_true", help="leave KISS-Matcher out")
    options = parser.parse_args(argv)
    if not options.maps or not Path(options.maps).is_dir():
        print("bench descriptors: give the folder of test maps by --maps or VOXJAX_MAPS.", file=sys.stderr)
        return 2
    try:
        peer = None if options.no_peer else load_peers(["kiss-matcher"])[0]
    except vx.InputError as error:
        print(f"bench descriptors: {error}", file=sys.stderr)
        return 2
    print(setting())
    print(f"{'pair':<22}{'found':>7}{'rank':>6}{'size':>6}{'best':>6}{'deg':>6}{'m':>7}", end="")
    print(f"{'describe s':>12}{'match s':>9}   KISS-Matcher: found, inliers, deg, m, s")
    found = peer_found = count = 0
    for folder in _folders(Path(options.maps), options.only):
        a, b, T, centroid = _load(folder)
        ours = _hypotheses(a, b, T, centroid)
        line, peer_right = ("", False) if peer is None else _run_peer(peer, a, b, T, centroid)
        print(f"{folder.name:<22}{ours[0]}   {line}", flush=True)
        found, peer_found, count = found + ours[1], peer_found + peer_right, count + 1
    print(
        f"found {found} of {count}" + ("" if options.no_peer else f"; KISS-Matcher {peer_found} of {count}")
    )
    return 0


def _folders(root: Path, only: str | None) -> list[Path]:
    real = sorted(p.parent for p in (root / "real").glob("*/truth.json"))
    if only is None:
        return real + [root / "sim" / name for name in SIMULATED.split(",") if (root / "sim" / name).is_dir()]
    return [p for name in only.split(",") for p in sorted(root.glob(f"*/{name}"))]


def _load(folder: Path) -> tuple[vx.VoxelGrid, vx.VoxelGrid, np.ndarray, np.ndarray]:
    truth = json.loads((folder / "truth.json").read_text())
    maps = []
    for name in "ab":
        cloud = folder / f"{name}.ply"
        maps.append(
            vx.read_map(cloud, voxel_size=truth["resolution"])
            if cloud.exists()
            else vx.read_map(folder / f"{name}.bt")
        )
    centroid = truth.get("b_centroid", maps[1].occupied_points().mean(axis=0, dtype=np.float64))
    return maps[0], maps[1], np.asarray(truth["T_a_b"]), np.asarray(centroid)


def _hypotheses(a: vx.VoxelGrid, b: vx.VoxelGrid, T: np.ndarray, centroid: np.ndarray) -> tuple[str, bool]:
    """Columns of the table for voxjax, and whether the pose was among the hypotheses."""
    spacing = working_spacing(a.voxel_size, b.voxel_size)
    use_free = min(a.num_free, b.num_free) > 0
    times, poses, sizes = [], np.zeros((0, 4, 4)), np.zeros(0)
    for _ in range(2):
        start = time.perf_counter()
        finest = max(finest_level(m, spacing=spacing) for m in (a, b))
        described = [describe_map(m, spacing=spacing, use_free_space=use_free, finest=finest) for m in (a, b)]
        middle = time.perf_counter()
        poses, sizes = descriptor_hypotheses(*described)
        times = [middle - start, time.perf_counter() - middle]
    errors = [pose_error(pose, T, centroid) for pose in poses]
    right = [i for i, error in enumerate(errors) if _is_found(error)]
    best = int(sizes[0]) if len(sizes) else 0
    if not right:
        columns = f"{'no':>7}{'-':>6}{'-':>6}{best:>6}{'-':>6}{'-':>7}"
    else:
        i = right[0]
        columns = f"{'yes':>7}{i:>6}{sizes[i]:>6}{best:>6}{errors[i][0]:>6.1f}{errors[i][1]:>7.2f}"
    return f"{columns}{times[0]:>12.2f}{times[1]:>9.2f}", bool(right)


def _is_found(error: PoseError) -> bool:
    """Return whether a pose is so near to the truth that refinement takes it from there."""
    return bool(error.degrees <= 10.0 and error.metres <= 1.0)


def _run_peer(
    peer: Peer, a: vx.VoxelGrid, b: vx.VoxelGrid, T: np.ndarray, centroid: np.ndarray
) -> tuple[str, bool]:
    """Columns of the table for KISS-Matcher before any refinement, and whether its pose is right."""
    start = time.perf_counter()
    found = peer.solve(a.occupied_points(), b.occupied_points(), working_spacing(a.voxel_size, b.voxel_size))
    seconds = time.perf_counter() - start
    error = pose_error(found.T_a_b, T, centroid)
    is_right = _is_found(error)
    answer = "yes" if is_right else "no"
    return f"{answer:>4}{found.score:>6.0f}{error[0]:>7.1f}{error[1]:>7.2f}{seconds:>6.2f}", is_right


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
