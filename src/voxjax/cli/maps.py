"""The maps that a command works on, read as its arguments say, and what is odd about them."""

import argparse
from collections.abc import Sequence

from ..io import LoadedMap, load_map
from .streams import warn


def load_maps(args: argparse.Namespace, paths: Sequence[str]) -> list[LoadedMap]:
    """Read maps with the options that all commands have for it.

    Raises:
        InputError: If one of them cannot be read or used.
    """
    return [
        load_map(
            path,
            voxel_size=args.voxel_size,
            crop=args.crop,
            drop_isolated=args.drop_isolated,
            strict=args.strict,
        )
        for path in paths
    ]


def warn_of_remarks(maps: Sequence[LoadedMap], paths: Sequence[str]) -> None:
    """Say on standard error, a line each, what a person should know about the maps."""
    for path, loaded in zip(paths, maps, strict=True):
        for remark in loaded.remarks:
            warn(f"{path}: {remark.text}.")
