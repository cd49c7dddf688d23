"""The maps that a command works on, read as its arguments say, and what is odd about them."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from .._checks import InputError
from ..io import LoadedMap, load_map
from ..io.crop import EmptyCrop
from .streams import warn


def load_maps(args: argparse.Namespace, paths: Sequence[str]) -> list[LoadedMap]:
    """Read maps with the options that all commands have for it.

    Raises:
        InputError: If one of them cannot be read or used.
    """
    with one_box_for_all(paths):
        return [load_map(path, **reading_options(args)) for path in paths]


@contextmanager
def one_box_for_all(paths: Sequence[str]) -> Iterator[None]:
    """Let the refusal of a crop that leaves nothing of one of several maps say that there is one box for all.

    Raises:
        InputError: As from within.
    """
    try:
        yield
    except EmptyCrop as error:
        if len(paths) < 2:
            raise
        raise InputError(
            f"{str(error).removesuffix('.')}; --crop is one box for all maps, of which each lies in a frame of its "
            "own: cut single maps before, with voxjax convert --crop."
        ) from error


def reading_options(args: argparse.Namespace) -> dict:
    """The options that all commands have for reading, by their names in `io.load_map`."""
    return {name: getattr(args, name) for name in ("voxel_size", "crop", "drop_isolated", "strict")}


def warn_of_remarks(maps: Sequence[LoadedMap], paths: Sequence[str]) -> None:
    """Say on standard error, a line each, what a person should know about the maps."""
    for path, loaded in zip(paths, maps, strict=True):
        for remark in loaded.remarks:
            warn(f"{path}: {remark.text}.")
