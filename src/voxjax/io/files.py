"""Content of files that somebody else made: never waits for a pipe, never reads without end."""

import os
import stat
from pathlib import Path

from .._checks import InputError
from .budget import Budget


def read_bytes(path: str | os.PathLike, *, most: int | None = None) -> bytes:
    """Read a whole file.

    Args:
        path: Name of the file.
        most: Largest file that is read [byte]; None for what there is memory for.

    Returns:
        What it holds. A file that grows meanwhile is read as long as it was in the beginning.

    Raises:
        InputError: If there is no such file, it cannot be read, is a folder, a device or a pipe, or is too large; the
            message is for a sentence that names it.
    """
    try:
        # The name is asked about before it is opened, for to open a device may have effects of its own.
        _check_kind(Path(path).stat().st_mode)
        # The name may lead to a pipe by now, and opening that waits for a writer unless told not to.
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        with open(os.open(path, flags), "rb") as file:
            status = os.fstat(file.fileno())
            _check_kind(status.st_mode)
            if most is not None and status.st_size > most:
                raise InputError(f"it holds {status.st_size:,} bytes, more than the {most:,} that make sense")
            Budget(status.st_size).check(status.st_size, "the file itself")
            return file.read(status.st_size)
    except (OSError, ValueError) as error:
        # An `InputError` is a `ValueError`, too, and has its sentence already.
        if isinstance(error, InputError):
            raise
        raise InputError(f"{getattr(error, 'strerror', None) or error}") from error


def _check_kind(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise InputError("it is a folder; give the name of a file")
    if not stat.S_ISREG(mode):
        raise InputError("it is a device or a pipe; copy what it gives to a file first")
