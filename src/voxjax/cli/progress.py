"""Names of stages with their seconds, while a command runs."""

import io
import sys
import time
from typing import TextIO


class Progress:
    """Names of stages with their seconds, on stderr.

    On a terminal the running stage is shown too and replaced when it ends; elsewhere a line appears for each
    stage that has ended.
    """

    def __init__(self, *, quiet: bool = False, stream: TextIO | io.TextIOBase | None = None):
        self._stream = None if quiet else (stream or sys.stderr)
        self._is_terminal = bool(self._stream and self._stream.isatty())
        # Back to the beginning of the line, and clear it; files must not hold what only a terminal obeys.
        self._clear = "\r\033[K" if self._is_terminal else ""
        self._stage: str | None = None
        self._start = 0.0
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, *_: object) -> None:
        """A stage begins, and with it the one before ends."""
        # The stages come one by one, so that the beginning of one is the end of the one before.
        self.finish()
        self._stage, self._start = stage, time.perf_counter()
        if self._is_terminal:
            self._write(f"{self._clear}  {stage} ...")

    def finish(self) -> None:
        """The last stage has ended."""
        if self._stage is None:
            return
        seconds = time.perf_counter() - self._start
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + seconds
        # What is cleared is the line of the running stage, which this one replaces.
        self._write(f"{self._clear}{seconds:8.1f} s  {self._stage}\n")
        self._stage = None

    def _write(self, text: str) -> None:
        if self._stream is not None:
            self._stream.write(text)
            self._stream.flush()
