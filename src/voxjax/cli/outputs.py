"""Output files: refused before the work when they cannot be written, and written together at its end."""

import contextlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from .._checks import InputError
from ..grid import VoxelGrid
from ..io import ENDINGS, encode_map
from ..io.atomic import check_writable, open_atomic

MAP_ENDINGS = ENDINGS


def check_outputs(outputs: Sequence[tuple[str | None, tuple[str, ...]]], *, force: bool) -> None:
    """Refuse output names that cannot be written, before any work.

    Args:
        outputs: Each file name with the endings it may have; the name None is an output not asked for.
        force: Whether files that exist may be overwritten.

    Raises:
        InputError: If a folder is missing, an ending is unknown, two outputs have one name, or a file exists.
    """
    seen = set()
    for name, endings in outputs:
        if name is None:
            continue
        if Path(name).suffix.lower() not in endings:
            raise InputError(f"{name}: the ending must be {' or '.join(endings)}.")
        check_writable(name, force=force)
        if not os.access(Path(name).parent, os.W_OK):
            raise InputError(f"{name}: the folder {Path(name).parent} is not writable.")
        place = Path(name).resolve()
        if place in seen:
            raise InputError(f"{name} is given for two outputs; use two names.")
        seen.add(place)


def write_outputs(contents: Mapping[str, bytes], *, force: bool) -> None:
    """Write all files or none: each to a temporary name first, then all take their names.

    Raises:
        InputError: If one cannot be written.
    """
    with contextlib.ExitStack() as stack:
        for name, data in contents.items():
            file = stack.enter_context(open_atomic(name, force=force))
            try:
                file.write(data)
            except OSError as error:
                raise InputError(f"{name} cannot be written: {error.strerror}.") from error


def map_bytes(name: str, grid: VoxelGrid) -> bytes:
    """The bytes of a map in the format of the name's ending."""
    return encode_map(name, grid)
