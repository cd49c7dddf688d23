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
    return [load_map(path, **reading_options(args)) for path in paths]


def reading_options(args: argparse.Namespace) -> dict:
    """The options that all commands have for reading, by their names in `io.load_map`."""
    return {name: getattr(args, name) for name in ("voxel_size", "crop", "drop_isolated", "strict")}


def warn_of_remarks(maps: Sequence[LoadedMap], paths: Sequence[str]) -> None:
    """Say on standard error, a line each, what a person should know about the maps."""
    for path, loaded in zip(paths, maps, strict=True):
        for remark in loaded.remarks:
            warn(f"{path}: {remark.text}.")
