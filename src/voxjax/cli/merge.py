"""`voxjax merge`: maps in, one map out, or an honest refusal."""

import argparse
import contextlib
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from .._checks import InputError
from .._runtime.whole_files import Content, write_files
from .._runtime.whole_folders import Folder, temporary_beside
from ..grid import VoxelGrid
from ..io import ENDINGS, LoadedMap, check_place, encode_map, read_map
from ..io.zarr_chunks import MARKER
from ..pipeline.config import Config
from ..pipeline.many import merge
from ..pipeline.merged import Merge
from ..pipeline.readable_poses import describe_pose
from ..pipeline.report import merge_report
from ..view import check_page_support, draw_merge, encode_png, page_html
from .guess import parse_guess
from .inputs import check_inputs, read_config
from .maps import load_maps, warn_of_remarks
from .outputs import check_outputs, json_bytes
from .progress import Progress
from .runtime import granted_memory, kept_kernels
from .streams import tell, warn


@kept_kernels()
def run(args: argparse.Namespace) -> int:
    """Merge maps as the arguments say and return the exit code."""
    with granted_memory(args.memory), contextlib.ExitStack() as temporaries:
        return _run(args, temporaries)


def _run(args: argparse.Namespace, temporaries: contextlib.ExitStack) -> int:
    """`run` with the memory granted; `temporaries` removes what the fused map is written to before it has its name."""
    _check(args)
    # A slip in a line of text is said before the maps are read, which may take long.
    guess = None if args.init_guess is None else parse_guess(args.init_guess)
    config = Config() if args.config is None else read_config(args.config)
    progress = Progress(quiet=args.quiet)
    progress("read")
    maps = load_maps(args, args.maps)
    # On a terminal the line of the running stage is replaced by the next one, and would take a remark with it.
    progress.finish()
    warn_of_remarks(maps, args.maps)
    grids = [loaded.grid for loaded in maps]
    # Said here, where the file can be named; the registration would only find no overlap.
    for path, grid in zip(args.maps, grids, strict=True):
        if grid.num_occupied == 0:
            raise InputError(
                f"{path} has no occupied voxel{_where(args)}, so there is nothing to align; leave it out."
            )
    # The fused map lies where the first map does, in its frame.
    check_place(args.output, grids[0])
    is_store = Path(args.output).suffix.lower() == ".zarr"
    store = temporary_beside(Path(args.output), temporaries, ".zarr") if is_store else None
    merged = merge(
        grids,
        preset=args.preset,
        rule=args.rule,
        gravity_aligned=args.gravity_aligned,
        allow_changes=args.allow_changes,
        init_guess=guess,
        config=config,
        on_stage=progress,
        out=store,
        num_processes=args.processes,
    )
    # A part of the maps is written only on request: a map that lacks a robot's part looks like a whole one.
    is_written = merged.status == "merged" or (merged.status == "partial" and args.allow_partial)
    # Before its times are written down, the report takes time of its own.
    report = None if args.report is None else _report(args, maps, merged, progress)
    progress("write")
    # All contents exist before the first file does: a fault while drawing leaves nothing behind.
    contents = _contents(args, grids, merged, report, is_written=is_written)
    if store is not None and args.output in contents:
        contents[args.output] = Folder(partial(os.rename, store), MARKER)
    write_files(contents, force=args.force)
    progress.finish()
    for line in summary(merged, args.maps):
        tell(line)
    if is_written:
        tell(f"{args.output}: {_described(args, merged)}")
        return 0
    warn(f"no map written: {refusal(merged, args.maps)}{_hint(merged, has_report=args.report is not None)}.")
    return 3


def _where(args: argparse.Namespace) -> str:
    """Where a map has been looked at, if not everywhere."""
    return (
        ""
        if args.crop is None
        else " in the box of --crop, which is one for all maps, in each one's own frame"
    )


def _described(args: argparse.Namespace, merged: Merge) -> str:
    """The fused map in a line; one in a store, which has got its name, is counted for that."""
    grid = merged.grid
    assert grid is not None
    if grid.is_stored:
        grid = read_map(args.output)
        _ = grid.num_occupied
    return repr(grid)


def summary(merged: Merge, names: Sequence[str]) -> list[str]:
    """Lines for a person: where each map lies, and how the pairs came out."""
    lines = []
    for number, (name, pose) in enumerate(zip(names, merged.poses, strict=True)):
        if pose is None or merged.grid is None:
            lines.append(f"{name}: {_why_unplaced(merged, number)}")
        else:
            lines.append(f"{name}: {describe_pose(pose, merged.middles[number], merged.grid.voxel_size)}")
    for a, b, registration in merged.pairs:
        lines.append(
            f"{names[a]} and {names[b]}: {registration.verdict}, confidence {registration.confidence:.2f}. "
            f"{registration.reason}".rstrip()
        )
    for loop in merged.loops:
        lines.append(
            f"loop check: {names[loop.a]} and {names[loop.b]}: {loop.metres:.2f} m and "
            f"{np.degrees(loop.radians):.2f} deg off the poses chained through the other maps."
        )
    return lines


def refusal(merged: Merge, names: Sequence[str]) -> str:
    """Why not all maps were merged, in words without a full stop; the reasons of the pairs stand in `summary`."""
    left_out = [name for name, pose in zip(names, merged.poses, strict=True) if pose is None]
    closest = merged.closest
    # With some maps merged, which were left out says more than why the closest pair of all failed.
    if merged.status == "partial" or closest is None:
        return (
            f"{len(names) - len(left_out)} of {len(names)} maps fit together, left out: {', '.join(left_out)}"
        )
    a, b, registration = closest
    verdict = f"{names[a]} and {names[b]}: {registration.verdict}"
    return verdict if len(merged.pairs) == 1 else f"no two maps fit together; closest are {verdict}"


def _hint(merged: Merge, *, has_report: bool) -> str:
    """What can be done about a refusal, to stand behind it."""
    hints = []
    if merged.status == "partial":
        hints.append("use --allow-partial to write the map of the others")
    if any(registration.hypotheses for _, _, registration in merged.pairs):
        hints.append(
            "the best pose of each pair is in the report, pairs[].T_a_b"
            if has_report
            else "give --report R.json to see the best pose of each pair"
        )
    return "".join(f"; {hint}" for hint in hints)


def _why_unplaced(merged: Merge, number: int) -> str:
    """That a map has no pose, and the best verdict of the pairs that it is in."""
    verdicts = {registration.verdict for a, b, registration in merged.pairs if number in (a, b)}
    if "accepted" in verdicts:
        return "not placed (accepted with maps that are themselves apart from the merged ones)"
    return f"not placed ({'ambiguous' if 'ambiguous' in verdicts else 'no_overlap'})"


def _check(args: argparse.Namespace) -> None:
    """Refuse arguments that cannot work, before any map is read."""
    if len(args.maps) < 2:
        raise InputError(f"merge needs at least two maps, got only {args.maps[0]}.")
    if args.init_guess is not None and len(args.maps) != 2:
        raise InputError(f"--init-guess is the pose of one pair, so it needs two maps, got {len(args.maps)}.")
    if args.processes > 1 and Path(args.output).suffix.lower() != ".zarr":
        raise InputError(
            f"--processes is for a fused map in a store (.zarr), got {args.output}; leave it out, or name a store."
        )
    check_inputs(args.maps)
    outputs = [
        (args.output, ENDINGS),
        (args.report, (".json",)),
        (args.picture, (".png",)),
        (args.html, (".html", ".htm")),
    ]
    check_outputs(outputs, force=args.force, inputs=[*args.maps, args.config, args.init_guess])
    # A missing package is said now, not after the merge.
    if args.html is not None:
        check_page_support()


def _report(args: argparse.Namespace, maps: Sequence[LoadedMap], merged: Merge, progress: Progress) -> bytes:
    """The report as JSON; corners that the registration did without are found for it, as a stage of their own."""
    found = merge_report(
        merged,
        [loaded.grid for loaded in maps],
        args.maps,
        remarks=[loaded.remarks for loaded in maps],
        seconds={"read": progress.seconds.get("read", 0.0)},
        on_stage=progress,
    )
    return json_bytes(found)


def _contents(
    args: argparse.Namespace,
    grids: Sequence[VoxelGrid],
    merged: Merge,
    report: bytes | None,
    *,
    is_written: bool,
) -> dict[str, Content]:
    """What all files to write hold: without a map to trust, the report alone."""
    contents = {}
    names = [Path(path).name for path in args.maps]
    if is_written and merged.grid is not None:
        contents[args.output] = encode_map(args.output, merged.grid)
        if args.picture is not None:
            contents[args.picture] = encode_png(draw_merge(grids, merged.poses, merged.grid, names=names))
        if args.html is not None:
            contents[args.html] = page_html(grids, merged.poses, merged.grid).encode()
    if report is not None:
        contents[args.report] = report
    return contents
