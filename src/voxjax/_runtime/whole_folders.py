"""Folders among the files of `whole_files`: made under a temporary name, and put in their place at the end.

No system replaces a folder that holds something in one step: the old one is named aside first, and for that moment
nothing bears its name.
"""

import contextlib
import os
import secrets
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Folder(NamedTuple):
    """What a folder is made of.

    Attributes:
        write: Makes a folder of the name that it is given, which nothing has, and all that is in it.
        marker: Name of a file that the folder holds: another folder is replaced only if it holds such a file too.
    """

    write: Callable[[Path], None]
    marker: str


def temporary_beside(path: Path, temporaries: contextlib.ExitStack, ending: str = ".tmp") -> Path:
    """A name beside `path` that nobody has; `temporaries` removes what will be there."""
    temporary = path.with_name(f".voxjax-{secrets.token_hex(8)}{ending}")
    # Registered before anything is there, because Ctrl-C may come at any time.
    temporaries.callback(remove, temporary)
    return temporary


def replace_folder(
    temporary: Path, path: Path, old: Path, renames: contextlib.ExitStack, *, force: bool
) -> None:
    """Give a folder its name.

    Args:
        temporary: The new folder.
        path: The name that it gets.
        old: A name that nothing has, for what is replaced.
        renames: Undoes what was done if the block ends with an error.
        force: Whether a folder or a file that has the name meanwhile is replaced.

    Raises:
        OSError: If one has it and is not to be replaced.
    """
    # Registered before the first step, because Ctrl-C may come between the two.
    renames.callback(_take_back, temporary, path, old)
    if force and os.path.lexists(path):
        os.rename(path, old)
    os.rename(temporary, path)


def remove(path: Path) -> None:
    """Remove a file, a link or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def flush_folder(folder: Path) -> None:
    """Bring a folder and all that is in it to the disk."""
    for place, _, names in os.walk(folder, topdown=False):
        for name in names:
            _flush(Path(place, name))
        # Some systems cannot open folders.
        with contextlib.suppress(OSError):
            _flush(Path(place))


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _take_back(temporary: Path, path: Path, old: Path) -> None:
    """Undo what `replace_folder` has done, as far as it came."""
    if not os.path.lexists(temporary):
        os.rename(path, temporary)
    if os.path.lexists(old):
        os.rename(old, path)
