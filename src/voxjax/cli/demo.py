"""`voxjax demo`: three generated robots, one map, checked against the truth."""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import rigid
from .._checks import InputError
from .._runtime.whole_files import write_files
from ..metrics import PoseError, pose_error
from ..pipeline.many import merge
from ..pipeline.report import merge_report
from ..synthetic import Team, simulate_team
from ..view import draw_merge, encode_png
from .merge import summary
from .outputs import check_outputs, map_bytes
from .runtime import Progress, kept_kernels
from .streams import tell, warn

MAX_DEGREES = 3.0
MAX_METRES = 0.4
"""A pose within these is right: the generated maps drift by centimetres."""


@kept_kernels()
def run(args: argparse.Namespace) -> int:
    """Generate, merge, compare, draw; return the exit code."""
    start = time.perf_counter()
    folder = _folder(args.out)
    names = [f"robot_{n}.bt" for n in (1, 2, 3)]
    paths = {name: str(folder / name) for name in [*names, "fused.bt", "report.json", "picture.png"]}
    check_outputs([(path, (Path(path).suffix,)) for path in paths.values()], force=args.force)
    progress = Progress(quiet=args.quiet)
    progress("generate a building and scan it with three robots")
    team = simulate_team(args.seed, num_robots=3, overlap=0.2)
    merged = merge(team.grids, on_stage=progress)
    progress("draw and write")
    contents = {paths[name]: map_bytes(name, grid) for name, grid in zip(names, team.grids, strict=True)}
    report = merge_report(merged, team.grids, [paths[name] for name in names])
    contents[paths["report.json"]] = (json.dumps(report, indent=1, allow_nan=False) + "\n").encode()
    if merged.grid is not None:
        contents[paths["fused.bt"]] = map_bytes("fused.bt", merged.grid)
        labels = [name.removesuffix(".bt").replace("_", " ") for name in names]
        picture = draw_merge(team.grids, merged.poses, merged.grid, names=labels)
        contents[paths["picture.png"]] = encode_png(picture)
    write_files(contents, force=args.force)
    progress.finish()
    for line in summary(merged, names):
        tell(line)
    errors = pose_errors(team, merged.poses)
    for name, error in zip(names[1:], errors, strict=True):
        found = "not merged" if error is None else f"{error.metres:.3f} m and {error.degrees:.2f} deg"
        tell(f"{name} against the truth: {found}")
    tell(f"{len(contents)} files in {folder}, {time.perf_counter() - start:.1f} s")
    if merged.status != "merged":
        warn(f"not all maps were merged: {merged.reason}")
        return 3
    if any(e is None or e.degrees > MAX_DEGREES or e.metres > MAX_METRES for e in errors):
        warn(f"a pose is off by more than {MAX_DEGREES} deg or {MAX_METRES} m.")
        return 1
    return 0


def pose_errors(team: Team, poses: Sequence[np.ndarray | None]) -> list[PoseError | None]:
    """Errors of the later maps' poses relative to the first map; None where either was left out."""
    errors: list[PoseError | None] = []
    for number in range(1, len(team.grids)):
        first, other, truth = poses[0], poses[number], team.true_pose(0, number)
        if first is None or other is None or truth is None:
            errors.append(None)
        else:
            found = rigid.inverse(np.asarray(first, np.float64)) @ np.asarray(other, np.float64)
            centre = team.grids[number].occupied_points().mean(axis=0, dtype=np.float64)
            errors.append(pose_error(found, truth, centre))
    return errors


def _folder(name: str) -> Path:
    """The folder for the files, made if it is missing."""
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be made: {error.strerror}.") from error
    return folder
