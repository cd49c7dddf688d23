"""What every command that computes sets up: the compilation cache and the progress display."""

import io
import os
import re
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import TextIO

from .._checks import InputError
from .._runtime.compilation_cache import PROGRAMS, keep_quickly_compiled_kernels, use_compilation_cache
from .streams import warn

_UNREADABLE = re.compile(r"Error reading persistent compilation cache entry for '([^']+)'")
_UNWRITTEN = re.compile(r"Error writing persistent compilation cache entry for '[^']+': (.+)", re.DOTALL)


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

    def act(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, *rest: object
    ) -> None:
        nonlocal is_said
        unreadable, unwritten = _UNREADABLE.match(str(message)), _UNWRITTEN.match(str(message))
        if unreadable:
            for entry in folder.glob(f"{escape(unreadable[1])}-*"):
                entry.unlink(missing_ok=True)
        elif unwritten:
            if not is_said:
                warn(f"compiled kernels cannot be kept in {folder}: {unwritten[1]}.")
            is_said = True
        else:
            show(message, category, filename, lineno, *rest)  # pyright: ignore[reportArgumentType]

    with warnings.catch_warnings():
        warnings.filterwarnings("always", message="Error (reading|writing) persistent compilation cache")
        warnings.showwarning = act
        yield


class Progress:
    """Names of stages with their seconds, on stderr.

    On a terminal the running stage is shown too and replaced when it ends; elsewhere a line appears for each
    stage that has ended.
    """

    def __init__(self, *, quiet: bool = False, stream: TextIO | io.TextIOBase | None = None):
        self._stream = None if quiet else (stream or sys.stderr)
        self._is_terminal = bool(self._stream and self._stream.isatty())
        self._stage: str | None = None
        self._start = 0.0
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, *_: object) -> None:
        """A stage begins, and with it the one before ends."""
        self.finish()
        self._stage, self._start = stage, time.perf_counter()
        if self._is_terminal:
            self._write(f"\r\033[K  {stage} ...")

    def finish(self) -> None:
        """The last stage has ended."""
        if self._stage is None:
            return
        seconds = time.perf_counter() - self._start
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + seconds
        self._write(
            f"{chr(13) + chr(27) + '[K' if self._is_terminal else ''}{seconds:8.1f} s  {self._stage}\n"
        )
        self._stage = None

    def _write(self, text: str) -> None:
        if self._stream is not None:
            self._stream.write(text)
            self._stream.flush()
