"""What every command that computes sets up: that kernels compiled in one run serve the next."""

import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path

from .._checks import InputError
from .._runtime.compilation_cache import PROGRAMS, keep_quickly_compiled_kernels, use_compilation_cache
from .streams import warn


@contextmanager
def kept_kernels() -> Iterator[None]:
    """Let JAX keep compiled kernels between runs, unless the user has said where or forbidden it.

    `VOXJAX_CACHE=off` switches it off; JAX's own `JAX_COMPILATION_CACHE_DIR` wins. A cache that cannot be used is no
    reason not to run: a folder that cannot be written is named in one line, and kernels that cannot be read are
    compiled again and their files removed, for JAX would keep them and compile again in every run.
    """
    if os.environ.get("VOXJAX_CACHE") == "off":
        yield
        return
    if chosen := os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        keep_quickly_compiled_kernels()
        if "://" not in chosen:  # JAX also takes addresses of stores
            _keep_programs(Path(chosen) / PROGRAMS)
        yield
        return
    try:
        folder = use_compilation_cache()
    except InputError as error:
        warn(f"{str(error).rsplit(';', 1)[0]}; set XDG_CACHE_HOME to another folder, or VOXJAX_CACHE=off.")
        yield
        return
    with _mended(folder):
        yield


def _keep_programs(folder: Path) -> None:
    """Keep programs in a folder, or say why not."""
    from .._runtime.programs import keep_programs

    try:
        keep_programs(folder)
    except OSError as error:
        warn(f"programs cannot be kept in {folder}: {error.strerror}.")


@contextmanager
def _mended(folder: Path) -> Iterator[None]:
    """Act on JAX's warnings of the cache instead of showing them; all others are shown."""
    show, is_said = warnings.showwarning, False
    entry_error = "Error {} persistent compilation cache entry for '([^']+)'"
    unreadable_entry = re.compile(entry_error.format("reading"))
    unwritten_entry = re.compile(entry_error.format("writing") + ": (.+)", re.DOTALL)

    def act(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, *rest: object
    ) -> None:
        nonlocal is_said
        unreadable, unwritten = unreadable_entry.match(str(message)), unwritten_entry.match(str(message))
        if unreadable:
            for entry in folder.glob(f"{escape(unreadable[1])}-*"):
                entry.unlink(missing_ok=True)
        elif unwritten:
            if not is_said:
                warn(f"compiled kernels cannot be kept in {folder}: {unwritten[2]}.")
            is_said = True
        else:
            show(message, category, filename, lineno, *rest)  # pyright: ignore[reportArgumentType]

    with warnings.catch_warnings():
        warnings.filterwarnings("always", message="Error (reading|writing) persistent compilation cache")
        warnings.showwarning = act
        yield
