"""`voxjax convert`: any readable format to any writable one."""

import argparse

from .._runtime.whole_files import write_files
from ..io import ENDINGS, encode_map, load_map
from .maps import reading_options, warn_of_remarks
from .outputs import check_outputs
from .streams import tell


def run(args: argparse.Namespace) -> int:
    """Convert a map and return the exit code."""
    check_outputs([(args.output, ENDINGS)], force=args.force, inputs=[args.input])
    # The names were checked before: reading takes long, and a refusal afterwards would waste it.
    loaded = load_map(args.input, **reading_options(args), scale=args.scale, shift=args.shift)
    # What is said of a map that was scaled or moved is true of it where it lies now.
    is_placed = args.scale != 1.0 or any(args.shift)
    warn_of_remarks([loaded], [f"{args.input} as {args.output}" if is_placed else args.input])
    grid = loaded.grid
    write_files({args.output: encode_map(args.output, grid)}, force=args.force)
    tell(f"{args.output}: {grid!r}")
    return 0
