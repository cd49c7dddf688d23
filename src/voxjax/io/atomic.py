"""Files that are written whole or not at all: a temporary file in the same folder, then a rename."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .._checks import InputError


def check_writable(path: str | os.PathLike, *, force: bool) -> Path:
    """Return `path` if a file may be written there; lets a command refuse before the work, not after it.

    Raises:
        InputError: If the folder is missing, the path is a folder, or the file exists and `force` is False.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first.")
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the name of a file.")
    if not force and path.exists():
        raise InputError(f"{path} exists already; use --force (force=True) to overwrite it, or another name.")
    return path


@contextlib.contextmanager
def open_atomic(path: str | os.PathLike, *, force: bool) -> Iterator[BinaryIO]:
    """Open a file for writing that takes its name only when the block ends without an error.

    Args:
        path: Final name.
        force: Whether an existing file may be replaced.

    Raises:
        InputError: As in `check_writable`, or if the file cannot be written.
    """
    path = check_writable(path, force=force)
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(6)}.tmp")
    try:
        # 0o666 less the umask, as for any new file; the tempfile module would make it private.
        descriptor = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666
        )
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            try:
                file.flush()
                os.fsync(file.fileno())
            except OSError as error:
                raise InputError(f"{path} cannot be written: {error.strerror}.") from error
        _give_name(temporary, path, force)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike, data: bytes, *, force: bool) -> None:
    """Write a whole file at once.

    Args:
        path: Final name.
        data: What the file holds.
        force: Whether an existing file may be replaced.

    Raises:
        InputError: As in `open_atomic`.
    """
    with open_atomic(path, force=force) as file:
        try:
            file.write(data)
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror}.") from error


def _give_name(temporary: Path, path: Path, force: bool) -> None:
    if not force:
        try:
            os.link(
                temporary, path
            )  # unlike a rename, this fails when another process made the file meanwhile
            return
        except FileExistsError:
            check_writable(path, force=False)
        except OSError:
            check_writable(path, force=False)  # a file system without links: the window for a race is short
    os.replace(temporary, path)
