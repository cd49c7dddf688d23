"""`voxjax demo`: three generated robots, one map, checked against the truth."""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import rigid
from .._checks import InputError
from .._runtime.whole_files import write_files
from ..grid import VoxelGrid
from ..io.octomap import decode_bt, encode_bt
from ..metrics import PoseError, pose_error
from ..pipeline.many import merge
from ..pipeline.merged import Merge
from ..pipeline.report import merge_report
from ..synthetic import Team, simulate_team
from ..view import draw_merge, encode_png
from .merge import refusal, summary
from .outputs import check_outputs, json_bytes
from .progress import Progress
from .runtime import kept_kernels
from .streams import tell, warn


@kept_kernels()
def run(args: argparse.Namespace) -> int:
    """Generate, merge, compare, draw; return the exit code."""
    start = time.perf_counter()
    folder = _folder(args.out)
    names = [f"robot_{n}.bt" for n in (1, 2, 3)]
    outputs = [*names, "fused.bt", "report.json", "picture.png"]
    check_outputs(
        [(str(folder / name), (Path(name).suffix,)) for name in outputs],
        force=args.force,
        advice="use --force to overwrite it, or another folder with --out",
    )
    progress = Progress(quiet=args.quiet)
    progress("generate a building and scan it with three robots")
    team = simulate_team(args.seed, num_robots=3, overlap=0.2)
    files = {str(folder / name): encode_bt(grid) for name, grid in zip(names, team.grids, strict=True)}
    # Nothing of the truth goes into the merge: it gets the maps alone, and of them what the files hold (states without
    # log-odds), so that `voxjax merge` of the files gives the same map.
    grids = [decode_bt(data) for data in files.values()]
    merged = merge(grids, on_stage=progress)
    report = merge_report(merged, grids, [str(folder / name) for name in names], on_stage=progress)
    progress("draw and write")
    # All files are written at once, after the merge: an interrupted demo leaves none behind.
    contents = files | _results(folder, names, grids, merged, json_bytes(report))
    write_files(contents, force=args.force)
    progress.finish()
    for line in summary(merged, names):
        tell(line)
    # Poses have no absolute frame: the first map is taken as right, and only the others can be wrong.
    errors = pose_errors(team, merged.poses)
    for name, error in zip(names[1:], errors, strict=True):
        found = "not merged" if error is None else f"{error.metres:.3f} m and {error.degrees:.2f} deg"
        tell(f"{name} against the truth: {found}")
    tell(f"{len(contents)} files in {folder}, {time.perf_counter() - start:.1f} s")
    if merged.status != "merged":
        warn(f"not all maps were merged: {refusal(merged, names)}.")
        return 3
    return _judge(errors)


def _results(
    folder: Path, names: Sequence[str], grids: Sequence[VoxelGrid], merged: Merge, report: bytes
) -> dict[str, bytes]:
    """The bytes of what came out of the merge: without a fused map, the report alone."""
    contents = {str(folder / "report.json"): report}
    if merged.grid is not None:
        fused = str(folder / "fused.bt")
        contents[fused] = encode_bt(merged.grid)
        labels = [name.removesuffix(".bt").replace("_", " ") for name in names]
        picture = draw_merge(grids, merged.poses, merged.grid, names=labels)
        contents[str(folder / "picture.png")] = encode_png(picture)
    return contents


def _judge(errors: Sequence[PoseError | None], *, max_degrees: float = 3.0, max_metres: float = 0.4) -> int:
    """The exit code: 1 if a pose is farther off than the generated maps drift, which is by centimetres."""
    if any(e is None or e.degrees > max_degrees or e.metres > max_metres for e in errors):
        warn(f"a pose is off by more than {max_degrees} deg or {max_metres} m.")
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
            # The product is one of float64: far from the origin, float32 would round away what is compared.
            found = rigid.inverse(np.asarray(first, np.float64)) @ np.asarray(other, np.float64)
            # An error of the angle moves far points more, so the centroid is where position is compared.
            centre = team.grids[number].occupied_points().mean(axis=0, dtype=np.float64)
            errors.append(pose_error(found, truth, centre))
    return errors


def _folder(name: str) -> Path:
    """The folder for the files, made if it is missing."""
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the folder {folder} cannot be made: {reason}; give another one to --out."
        ) from error
    return folder
