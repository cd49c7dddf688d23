"""Output files: refused before the work when they cannot be written."""

import json
from collections.abc import Sequence
from pathlib import Path

from .._checks import InputError
from .._runtime.whole_files import check_writable


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
        # Two names may lead to one place, as a.bt and ./a.bt do.
        try:
            place = Path(name).resolve()
        except OSError as error:  # somebody has removed the working folder
            raise InputError(f"{name}: the working folder is gone; change to another one.") from error
        if place in seen:
            raise InputError(f"{name} is given for two outputs; use two names.")
        seen.add(place)


def json_bytes(value: dict) -> bytes:
    """The bytes of a JSON file, which holds finite numbers only."""
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()
