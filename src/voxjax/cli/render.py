"""`voxjax render`: maps as a picture."""

import argparse
from pathlib import Path

from .._checks import InputError
from .._runtime.whole_files import write_files
from ..view import draw_maps, encode_png
from .maps import load_maps, warn_of_remarks
from .outputs import check_outputs
from .streams import tell


def run(args: argparse.Namespace) -> int:
    """Draw maps and return the exit code."""
    check_outputs([(args.output, (".png",))], force=args.force, inputs=args.maps)
    maps = load_maps(args, args.maps)
    warn_of_remarks(maps, args.maps)
    grids = [loaded.grid for loaded in maps]
    for path, grid in zip(args.maps, grids, strict=True):
        if not grid.num_voxels:
            raise InputError(f"{path} has no voxels, so there is nothing to draw; leave it out.")
    names = [Path(path).name for path in args.maps]
    picture = encode_png(draw_maps(grids, names=names, cut_ceiling=not args.keep_ceiling))
    write_files({args.output: picture}, force=args.force)
    # A PNG begins with a header of fixed length that holds its width and height.
    height, width = int.from_bytes(picture[20:24], "big"), int.from_bytes(picture[16:20], "big")
    tell(f"{args.output}: {width} x {height} pixels")
    return 0
