"""Files and folders that are written whole or not at all, one or several together.

All contents are written under temporary names in the folders of their files first; only when each of them is on the
disk do the files take their names. Whatever goes wrong, a full disk or Ctrl-C, no temporary file stays.
"""

import contextlib
import errno
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from .._checks import InputError, shown
from .whole_folders import Folder, flush_folder, replace_folder, temporary_beside

FilePath = str | os.PathLike
Content = bytes | Folder


def check_writable(
    path: FilePath,
    *,
    force: bool,
    advice: str = "give force=True to overwrite it, or another name",
    marker: str | None = None,
) -> Path:
    """Return `path` if a file or a folder may be written there; lets a command refuse before the work, not after it.

    A link counts as the file that it leads to, and is itself replaced.

    Args:
        path: Name of the file.
        force: Whether a file or a link of that name may be replaced.
        advice: What to do where something of that name exists.
        marker: What is written is a folder, which replaces folders only that hold a file of this name; None for a file.

    Raises:
        InputError: If the folder is missing or not writable, the name is impossible or that of a device, a pipe or
            another folder, or something of that name exists and `force` is False.
    """
    path = Path(path)
    try:
        parent, target = _mode_of(path.parent), _mode_of(path)
    except (OSError, ValueError) as error:  # the name is too long or holds a zero, the folder is closed
        raise InputError(f"{shown(str(path))} cannot be written: {_reason(error)}.") from error
    if parent is None or not stat.S_ISDIR(parent):
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first.")
    is_folder = target is not None and stat.S_ISDIR(target)
    if is_folder and marker is None:
        raise InputError(f"{path} is a folder; give the name of a file.")
    if is_folder and not (path / str(marker)).is_file():
        raise InputError(
            f"{path} is a folder without a file {marker}, which is never replaced; use another name."
        )
    if target is not None and not is_folder and not stat.S_ISREG(target):
        raise InputError(f"{path} is a device or a pipe, which cannot be replaced; give the name of a file.")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} is not writable; choose another one.")
    if not force and os.path.lexists(path):
        what = "exists already" if target is not None else "is a link that leads nowhere"
        raise InputError(f"{path} {what}; {advice}.")
    return path


def write_file(
    path: FilePath, data: bytes, *, force: bool, mode: int = 0o666, is_durable: bool = True
) -> None:
    """Write one file; see `write_files`."""
    write_files({Path(path): data}, force=force, mode=mode, is_durable=is_durable)


def write_files(
    contents: Mapping[str, Content] | Mapping[Path, Content],
    *,
    force: bool,
    mode: int = 0o666,
    is_durable: bool = True,
) -> None:
    """Write all files and folders or none.

    Args:
        contents: What each file or folder holds, by its final name.
        force: Whether those that exist may be replaced.
        mode: Permissions of the files, less the umask.
        is_durable: Whether to wait until the disk has them, so that they outlive a crash of the machine.

    Raises:
        InputError: As in `check_writable`, or if one cannot be written: a full disk, a limit of size.
    """
    written: list[tuple[Path, Path]] = []
    # The inner stack ends first: old files get their names back before temporary names are removed, theirs included.
    with contextlib.ExitStack() as temporaries, contextlib.ExitStack() as renames:
        for name, data in contents.items():
            marker = data.marker if isinstance(data, Folder) else None
            path = check_writable(name, force=force, marker=marker)
            with _explained(path):
                temporary = temporary_beside(path, temporaries)
                if isinstance(data, Folder):
                    _write_folder(temporary, data, is_durable)
                else:
                    _write(temporary, data, mode, is_durable)
            written.append((temporary, path))
        for temporary, path in written:
            with _explained(path):
                if temporary.is_dir():
                    replace_folder(temporary, path, temporary_beside(path, temporaries), renames, force=force)
                elif force:
                    _replace(temporary, path, temporaries, renames)
                else:
                    _take_new_name(temporary, path, renames)
        renames.pop_all()  # all have their names: nothing is to be taken back
    if is_durable:
        _flush_folders({path.parent for _, path in written})


def _write(temporary: Path, data: bytes, mode: int, is_durable: bool) -> None:
    """Write, flush and close a new file; a full disk may show at each of these steps."""
    # O_EXCL fails on any name that is there, so nothing is written through a link that somebody has put in its place.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    with open(os.open(temporary, flags, mode), "wb") as file:
        file.write(data)
        # `fsync` brings to the disk what the system holds, and knows nothing of what Python still holds back.
        file.flush()
        if is_durable:
            os.fsync(file.fileno())


def _write_folder(temporary: Path, folder: Folder, is_durable: bool) -> None:
    """Make a new folder and flush all that is in it."""
    folder.write(temporary)
    if is_durable:
        flush_folder(temporary)


def _take_new_name(temporary: Path, path: Path, renames: contextlib.ExitStack) -> None:
    """Name a file as nothing is named yet; `renames` takes the name back."""
    try:
        os.link(temporary, path)  # unlike a rename, this fails when another process made the file meanwhile
    except OSError:
        # A file system without links, unless this raises: there the window for a race is short.
        check_writable(path, force=False)
        os.replace(temporary, path)
    renames.callback(path.unlink, missing_ok=True)


def _replace(
    temporary: Path, path: Path, temporaries: contextlib.ExitStack, renames: contextlib.ExitStack
) -> None:
    """Name a file as another one may be named; `renames` brings that one back."""
    # A second name keeps the old file alive until all files have their names.
    old = temporary_beside(path, temporaries)
    try:
        os.link(path, old, follow_symlinks=False)
    except FileNotFoundError:
        renames.callback(path.unlink, missing_ok=True)
    except (OSError, NotImplementedError):
        pass  # a file system or a system without links: what is replaced cannot be brought back
    else:
        renames.callback(os.replace, old, path)
    os.replace(temporary, path)


def _flush_folders(folders: Iterable[Path]) -> None:
    """Let the disk know the new names too, where the system can open folders."""
    for folder in folders:
        with contextlib.suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def _mode_of(path: Path) -> int | None:
    """Type and permissions of what a name leads to; None where it leads to nothing."""
    try:
        return path.stat().st_mode
    except OSError as error:
        # Nothing there, a file where a folder should be, and links in a circle: none of them leads to anything.
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ELOOP):
            return None
        raise


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        is_full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        advice = "; make room for it, or choose another folder" if is_full else ""
        raise InputError(f"{path} cannot be written: {_reason(error)}{advice}.") from error


def _reason(error: OSError | ValueError) -> str:
    return getattr(error, "strerror", None) or str(error)
