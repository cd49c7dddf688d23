"""Files of kept programs: their names, and reading and writing them whole or not at all."""

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import warnings
from pathlib import Path

from .._checks import InputError
from .private_folders import NotPrivateError, read_private
from .whole_files import write_file

_NAME, _ENDING = 32, ".program"
"""Parts of a file's name: the length of each of the two digests in it, and what comes after them."""


class KeptProgramWarning(UserWarning):
    """A kept program or kernel that cannot be used or written; it is made again."""


@functools.cache
def version_digest() -> str:
    """What traces programs: versions of packages, and sizes and times of this package's files, which are edited."""
    traced_by = ("voxjax", "jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
    found = [f"{name} {importlib.metadata.version(name)}" for name in traced_by]
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        # Sizes and times stand for what is in the files, so that none of them has to be read.
        status = path.stat()
        found.append(f"{path.relative_to(root)} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(found).encode()).hexdigest()[:_NAME]


def program_path(folder: Path, digest: str) -> Path:
    """File of the program of a digest that these versions trace."""
    return folder / f"{version_digest()}-{digest[:_NAME]}{_ENDING}"


def last_used(folder: Path, most: int = 24) -> list[Path]:
    """Files of programs of these versions, in the order in which they were used; the last `most` of them."""
    used = [(_time_of(path), path) for path in folder.glob(f"{version_digest()}-*{_ENDING}")]
    known = sorted((time, path) for time, path in used if time is not None)
    return [path for _, path in known[-most:]]


def _time_of(path: Path) -> int | None:
    """Time of last use; None where a file has gone since it was listed."""
    try:
        return path.lstat().st_mtime_ns
    except OSError:
        return None


def read_whole(path: Path) -> bytes | None:
    """Content of a file that was written whole, by nobody but this user; else None."""
    try:
        content = read_private(path)
    except FileNotFoundError:
        return None
    except (OSError, NotPrivateError) as error:
        warnings.warn(f"a kept program is not used: {error}.", KeptProgramWarning, stacklevel=2)
        return None
    size = hashlib.sha256().digest_size  # the digest of the rest comes first, see `write_whole`
    is_whole = hashlib.sha256(content[size:]).digest() == content[:size]
    return content[size:] if is_whole else None


def mark_as_used(path: Path) -> None:
    """Set the time of a file, by which the next process knows what to load first."""
    with contextlib.suppress(OSError):  # a folder that cannot be written serves as well
        os.utime(path)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; what cannot be written is traced again by the next process."""
    marked = hashlib.sha256(content).digest() + content
    try:
        # The digest shows what a crash of the machine has damaged, so that nobody needs to wait for the disk.
        write_file(path, marked, force=True, mode=0o600, is_durable=False)
    except InputError as error:
        warnings.warn(f"programs cannot be kept in {path.parent}: {error}", KeptProgramWarning, stacklevel=2)
