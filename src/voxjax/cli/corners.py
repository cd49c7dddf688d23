"""`voxjax corners`: the detected corners as a table."""

import argparse

import numpy as np

from .._runtime.whole_files import write_files
from ..features.corners import Corners, detect_corners
from ..grid import VoxelGrid
from .maps import load_maps, warn_of_remarks
from .outputs import check_outputs
from .runtime import kept_kernels
from .streams import tell


@kept_kernels()
def run(args: argparse.Namespace) -> int:
    """Detect the corners of a map, write them and return the exit code."""
    check_outputs([(args.output, (".csv",))], force=args.force, inputs=[args.map])
    maps = load_maps(args, [args.map])
    warn_of_remarks(maps, [args.map])
    corners = detect_corners(maps[0].grid, virtual=args.virtual, preset=args.preset)
    write_files({args.output: corners_csv(corners).encode()}, force=args.force)
    mask = np.asarray(corners.mask)
    num_observed = int(np.count_nonzero(mask & np.asarray(corners.is_observed)))
    num_virtual = int(np.count_nonzero(mask)) - num_observed
    hint = "" if num_observed or args.virtual else _hint(maps[0].grid, args.preset)
    tell(f"{args.output}: {num_observed} observed and {num_virtual} virtual corners{hint}")
    return 0


def _hint(grid: VoxelGrid, preset: str) -> str:
    """Why no corner was observed and what finds some, to stand behind the number; the paper's method has neither."""
    if preset == "paper":
        return "; the default preset has --virtual ones, where planes meet unseen"
    if not grid.num_free:
        # A face counts as seen where free space lies before it.
        return (
            "; without free space no corner is observed, and this map has none: --virtual gives those where its planes "
            "meet"
        )
    return "; --virtual also gives those where planes meet unseen"


def corners_csv(corners: Corners) -> str:
    """A table with a corner a line: position [m], three unit normals into free space, "observed" or "virtual"."""
    # Rows beyond the found corners are padding, which no table must show.
    mask = np.asarray(corners.mask)
    rows = zip(
        np.asarray(corners.position)[mask],
        np.asarray(corners.normals)[mask].reshape(-1, 9),
        np.asarray(corners.is_observed)[mask],
        strict=True,
    )
    lines = ["x,y,z," + ",".join(f"n{row}{axis}" for row in (1, 2, 3) for axis in "xyz") + ",kind"]
    for position, normals, is_observed in rows:
        # Places are written to a tenth of a millimetre, far below a voxel.
        numbers = [f"{value:.4f}" for value in position] + [f"{value:.5f}" for value in normals]
        lines.append(",".join([*numbers, "observed" if is_observed else "virtual"]))
    return "\n".join(lines) + "\n"
