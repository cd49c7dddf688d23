"""Standard output and error that never end a command: a reader that has gone, a full disk, a letter it cannot encode.

What a command has done decides its exit code; whether somebody still reads what it prints does not.
"""

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import TextIO


class LastingStream:
    """A text stream whose writer is told of no failure; it stands in for `sys.stdout` or `sys.stderr`.

    Attributes:
        failure: Why nothing can be written any more; None while all goes well.
    """

    def __init__(self, stream: TextIO | io.TextIOBase | None):
        """Wrap a stream; None, which Python has for a closed descriptor, swallows all."""
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write the text, with an escape for each letter that the stream cannot encode."""
        # After the first failure nothing is tried again: the reader that has gone does not come back.
        if self._stream is None or self.failure is not None:
            return len(text)
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        try:
            return self._stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        except OSError as error:
            self._fail(error)
            return len(text)

    def flush(self) -> None:
        """Hand on what is buffered."""
        if self._stream is None or self.failure is not None:
            return
        try:
            self._stream.flush()
        except OSError as error:
            self._fail(error)

    def isatty(self) -> bool:
        """Whether a person watches."""
        return self._stream is not None and self._stream.isatty()

    def __getattr__(self, name: str) -> object:
        """Everything else, such as the descriptor, is the stream's own."""
        return getattr(self._stream, name)

    def _fail(self, error: OSError) -> None:
        """Remember the failure, and let Python's own flush at the end of the process succeed."""
        self.failure = error
        assert self._stream is not None
        with contextlib.suppress(OSError):  # a stream without a descriptor has no flush that could fail
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._stream.fileno())
            os.close(null)


@contextlib.contextmanager
def lasting_streams() -> Iterator[LastingStream]:
    """Let `print` write to lasting streams within the block; gives the one for standard output."""
    output, errors = LastingStream(sys.stdout), LastingStream(sys.stderr)
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):  # pyright: ignore[reportArgumentType]
        try:
            yield output
        finally:
            # Python itself flushes its streams at the end, where a failure could no longer be handled.
            output.flush()
            errors.flush()


@contextlib.contextmanager
def warnings_as_sentences() -> Iterator[None]:
    """Let Python's warnings within the block be one line each, without the line of code that they point to."""

    def show(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: object) -> None:
        warn(f"{message} ({category.__name__}, {os.path.basename(filename)}:{lineno})")

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


def printable(text: object) -> str:
    """The text on one line that a terminal can show: an escape for a line break, a control character, a lone surrogate.

    Names of files may hold any byte, and a terminal obeys some of them.
    """
    # `unicode_escape` knows an escape for lone surrogates too, which no encoding of a terminal can write.
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))


def tell(text: str) -> None:
    """Say one line on standard output."""
    print(printable(text))


def warn(text: str) -> None:
    """Say one sentence on standard error, at most as long as a person reads."""
    line = printable(" ".join(text.split()))
    if len(line) > 1200:  # an input quotes itself; the rule stands before it and the advice behind
        line = f"{line[:600]} ... {line[-500:]}"
    print(f"voxjax: {line}", file=sys.stderr)
