"""Folders and files whose content runs as code here, and that nobody else may therefore write.

A compiled kernel is machine code, and a kept program may call any function that XLA knows: whoever can write them can
run code in the process that loads them. So a folder or a file that belongs to someone else, or that others can write,
is not used. Where the system knows no owners (Windows), folders of the user are protected by their place.
"""

import os
import stat
from pathlib import Path

from .._checks import InputError

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class NotPrivateError(Exception):
    """A file or folder that somebody else could have written; the message says why."""


def private_folder(path: Path) -> Path:
    """Make a folder that only its user may enter, with all folders above that are missing; or check the one there is.

    Raises:
        InputError: If the folder, or a link of its name, belongs to someone else or can be written by others; or if
            one above it does, so that they could put another in its place.
        OSError: If it cannot be made or is no folder.
    """
    # Folders are made one by one: `mkdir(parents=True)` would make the folders above with the default mode.
    missing = [folder for folder in (path, *path.parents) if not os.path.lexists(folder)]
    for folder in reversed(missing):
        # Another process may make it first: whoever did, it is checked below.
        folder.mkdir(mode=0o700, exist_ok=True)
    if not path.is_dir():
        raise NotADirectoryError(20, "Not a directory", str(path))
    try:
        # Both are asked, the link and what it leads to: whoever owns the link may lead it elsewhere later.
        _check_owner(path.lstat(), str(path), is_link=path.is_symlink())
        _check_owner(path.stat(), str(path))
        _check_above(path)
    except NotPrivateError as error:
        raise InputError(
            f"compiled kernels cannot be kept in {path}: {error}, so that others could run code here; name another "
            "folder."
        ) from error
    return path


def read_private(path: Path) -> bytes:
    """Content of a file that nobody else can have written.

    Raises:
        NotPrivateError: If somebody else can have.
        OSError: If it cannot be read; a link is never followed.
    """
    names = ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY")  # a pipe without a writer would wait for one
    # Not all systems have all of these flags; one that is missing is left out.
    flags = os.O_RDONLY
    for name in names:
        flags |= getattr(os, name, 0)
    with open(os.open(path, flags), "rb") as file:
        # The open file is asked, not its name: that may lead elsewhere by now.
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise NotPrivateError(f"{path.name} is no file")
        _check_owner(status, path.name)
        return file.read()


def remove_foreign_files(folder: Path, ending: str) -> int:
    """Remove links and files in a private folder that somebody else can have written; say how many there were.

    Args:
        folder: A folder whose files a library reads that asks for no owner.
        ending: The end of the names of these files.
    """
    if not hasattr(os, "getuid"):
        return 0
    # Nobody else reaches a file in a folder that only its owner may enter, whatever the file's own mode is.
    is_closed = not folder.stat().st_mode & (stat.S_IXGRP | stat.S_IXOTH)
    count = 0
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(ending) and not _is_own(entry, is_closed=is_closed):
                Path(entry.path).unlink(missing_ok=True)
                count += 1
    return count


def _is_own(entry: os.DirEntry, *, is_closed: bool) -> bool:
    try:
        status = entry.stat(follow_symlinks=False)
    except FileNotFoundError:  # another process has removed it since it was listed
        return True
    is_writable = bool(status.st_mode & _OTHERS_WRITE) and not is_closed
    return stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid() and not is_writable


def _check_owner(status: os.stat_result, name: str, *, is_link: bool = False) -> None:
    """Raise unless something belongs to this user and to nobody else's pen; the mode of a link means nothing."""
    if not hasattr(os, "geteuid"):
        return
    if status.st_uid != os.geteuid():
        raise NotPrivateError(f"{name} belongs to someone else")
    if status.st_mode & _OTHERS_WRITE and not is_link:
        raise NotPrivateError(f"{name} can be written by others")


def _check_above(path: Path) -> None:
    """Raise if someone else may put another folder in the place of this one, or of one above it.

    A folder may be renamed by whoever owns or can write the one above it, whatever its own owner and mode are. So each
    folder up to the root must belong to this user or to the system, and be writable for nobody else; as OpenSSH asks of
    the folders above its keys, that goes for groups of a single user too, because who is in a group may change.
    """
    if not hasattr(os, "geteuid"):
        return
    # A link on the way lies in folders of its own, beside those above what it leads to.
    for folder in dict.fromkeys((*path.absolute().parents, *path.resolve().parents)):
        status = folder.stat()
        # The system's own user, 0, can write everywhere in any case.
        if {folder.lstat().st_uid, status.st_uid} - {os.geteuid(), 0}:
            raise NotPrivateError(f"{folder} above it belongs to someone else")
        # The sticky bit, as /tmp has it, keeps what lies in a folder with its owners.
        if status.st_mode & _OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
            raise NotPrivateError(f"others can write {folder} above it (chmod go-w)")
