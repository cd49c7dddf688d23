"""Output files: refused before the work when they cannot be written."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

from .._checks import InputError
from .._runtime.whole_files import check_writable
from ..io.zarr_chunks import MARKER as ZARR_MARKER
from ..io.zarr_reading import check_zarr_support


def check_outputs(
    outputs: Sequence[tuple[str | None, tuple[str, ...]]],
    *,
    force: bool,
    inputs: Sequence[str | None] = (),
    advice: str = "use --force to overwrite it, or another name",
) -> None:
    """Refuse output names that cannot be written, before any work.

    Args:
        outputs: Each file name with the endings it may have; the name None is an output not asked for.
        force: Whether files that exist may be overwritten.
        inputs: Names of the files that the command reads, None for one not given: no output may replace them, whatever
            `force` says.
        advice: What to do where a file exists.

    Raises:
        InputError: If a folder is missing, an ending is unknown, two outputs have one name, an output is an input, or a
            file exists.
    """
    seen = set()
    for name, endings in outputs:
        if name is None:
            continue
        if Path(name).suffix.lower() not in endings:
            raise InputError(f"{name}: the ending must be {' or '.join(endings)}.")
        if any(_is_same_file(name, source) for source in inputs if source is not None):
            raise InputError(f"{name} is one of the inputs, which are never replaced; use another name.")
        is_store = Path(name).suffix.lower() == ".zarr"
        if is_store:  # a missing package is said now, not after the work
            check_zarr_support()
        # Inputs are looked at first, because --force would let this pass.
        check_writable(name, force=force, advice=advice, marker=ZARR_MARKER if is_store else None)
        # Two names may lead to one place, as a.bt and ./a.bt do.
        try:
            place = Path(name).resolve()
        except OSError as error:  # somebody has removed the working folder
            raise InputError(f"{name}: the working folder is gone; change to another one.") from error
        if place in seen:
            raise InputError(f"{name} is given for two outputs; use two names.")
        seen.add(place)


def _is_same_file(name: str, other: str) -> bool:
    """Whether both names lead to one file that exists, by links too."""
    try:
        return os.path.samefile(name, other)
    except (OSError, ValueError):  # one of them leads to nothing; who reads or writes it says so
        return False


def json_bytes(value: dict) -> bytes:
    """The bytes of a JSON file, which holds finite numbers only."""
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()
