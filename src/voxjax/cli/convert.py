"""`voxjax convert`: any readable format to any writable one."""

import argparse

from .._runtime.whole_files import write_files
from ..io import ENDINGS, encode_map
from .maps import load_maps, warn_of_remarks
from .outputs import check_outputs
from .streams import tell


def run(args: argparse.Namespace) -> int:
    """Convert a map and return the exit code."""
    check_outputs([(args.output, ENDINGS)], force=args.force, inputs=[args.input])
    # The names were checked before: reading takes long, and a refusal afterwards would waste it.
    maps = load_maps(args, [args.input])
    warn_of_remarks(maps, [args.input])
    grid = maps[0].grid
    write_files({args.output: encode_map(args.output, grid)}, force=args.force)
    tell(f"{args.output}: {grid!r}")
    return 0
