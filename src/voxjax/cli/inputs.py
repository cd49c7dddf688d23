"""Files that a command reads besides maps, and names of maps that lead to nothing."""

import os
import stat
import tomllib
from collections.abc import Sequence

from .._checks import InputError
from ..io.files import read_bytes
from ..pipeline.config import Config, config_from


def check_inputs(paths: Sequence[str]) -> None:
    """Refuse maps that are not there before any other one is read.

    Raises:
        InputError: If a name leads to nothing or to a folder, or cannot be one.
    """
    for path in paths:
        try:
            mode = os.stat(path).st_mode
        except (OSError, ValueError) as error:  # no such file, a name too long or with a NUL in it
            raise InputError(
                f"{path} cannot be read: {getattr(error, 'strerror', None) or error}."
            ) from error
        # Pipes and devices are let through: what cannot be read as a map is said by the reader.
        if stat.S_ISDIR(mode) and os.path.splitext(path)[1].lower() != ".zarr":
            raise InputError(f"{path} cannot be read: it is a folder; give the name of a file.")


def read_config(path: str) -> Config:
    """Return the settings in a TOML file; what it does not name keeps its default.

    Raises:
        InputError: If the file cannot be read, is no TOML, or sets what does not exist.
    """
    try:
        # Python's parser takes time with the square of a name's dots: 3 s for the worst file of this size.
        text = read_bytes(path, most=1 << 15).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no TOML file: it is not UTF-8; save it as such.") from error
    except InputError as error:
        raise InputError(f"{path} cannot be read: {error}.") from error
    try:
        return config_from(tomllib.loads(text))
    except RecursionError as error:
        raise InputError(
            f"{path} is nested too deeply for settings; write tables of keys and values."
        ) from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (ValueError, OverflowError) as error:
        # Either is what TOML forbids, or a number of more digits than Python takes.
        raise InputError(f"{path} is no TOML file: {str(error).partition(';')[0]}.") from error
