"""Which files of chunks an array of a Zarr store has: the names in its folder that are keys of it, of either form."""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from .._checks import InputError
from ..ops.blocks.block_array import Shape
from .zarr_chunks import MARKER, file_named
from .zarr_shards import Place


def known_files(folder: Path, lattice: Shape, key: Callable[[Place], str]) -> Bool[np.ndarray, "a b c"]:
    """Which files of chunks an array has; names that are no keys of it are none, as they are none to zarr.

    Args:
        folder: The folder of the array.
        lattice: How many files it may have along x, y, z.
        key: Gives the name of a file: c/0/0/0, c.0.0.0, 0/0/0 or 0.0.0.

    Raises:
        InputError: If the file of a chunk is none, or a folder on the way to it is none of chunks; the message is for a
            sentence that names the store.
    """
    known = np.zeros(lattice, bool)
    parts = key((0, 0, 0)).split("/")
    forms = [re.compile(re.escape(part).replace("0", "(0|[1-9][0-9]{0,9})")) for part in parts]
    folders: list[tuple[str, tuple[int, ...]]] = [("", ())]
    while folders:
        prefix, numbers = folders.pop()
        level = prefix.count("/")
        for entry, more in _entries(folder, prefix, forms[level]):
            place = (*numbers, *more)
            if any(number >= n for number, n in zip(place, lattice, strict=False)):
                continue
            if level + 1 < len(forms):
                folders.append((f"{prefix}{entry.name}/", place))
                continue
            name = f"{folder.name}/{prefix}{entry.name}"
            with file_named(name):
                if not entry.is_file():  # a pipe would be waited for
                    raise InputError(f"{name} is no file, and a chunk is one")
            known[place] = True
    return known


def _entries(
    folder: Path, prefix: str, form: re.Pattern[str]
) -> Iterator[tuple[os.DirEntry[str], tuple[int, ...]]]:
    """What lies in a folder on the way to chunks under a name of a form, and the numbers in that."""
    name = f"{folder.name}/{prefix}".rstrip("/")
    with file_named(name), os.scandir(folder / prefix) as entries:
        found = list(entries)
    # A link may lead back to the array or to another one, whose chunks would be missed here without a word.
    if prefix and any(entry.name == MARKER for entry in found):
        raise InputError(f"{name} holds a {MARKER}, and a folder of chunks holds none")
    for entry in found:
        if match := form.fullmatch(entry.name):
            yield entry, tuple(map(int, match.groups()))
