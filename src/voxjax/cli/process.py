"""What a process needs that runs one command: signals, open descriptors, no search for garbage in between."""

import contextlib
import gc
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import NoReturn


class Stopped(BaseException):
    """A signal asked the process to end; as an exception it lets every block remove its temporary files."""

    def __init__(self, number: int):
        """Keep the number of the signal."""
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number


def open_closed_descriptors() -> None:
    """Lead closed standard descriptors to nowhere, lest the next file that is opened takes all that is printed."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one


def leave_on_interrupt() -> None:
    """Let Ctrl-C end the process at once, without a word of Python's.

    This is for the time of imports: nothing is to be cleaned up, and an exception out of the middle of a library's
    initialisation becomes another one or a traceback.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, as under nohup
        signal.signal(signal.SIGINT, _leave)


@contextlib.contextmanager
def signals_raise() -> Iterator[None]:
    """Within the block Ctrl-C raises KeyboardInterrupt, and requests to end raise `Stopped`.

    Only the main thread may handle signals; in another one nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {}
    try:
        if signal.getsignal(signal.SIGINT) is _leave:
            before[signal.SIGINT] = signal.signal(signal.SIGINT, signal.default_int_handler)
        for name in ("SIGTERM", "SIGHUP"):  # Windows has no SIGHUP
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, _raise_stopped)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def garbage_collection_put_off(*, for_good: bool) -> Iterator[None]:
    """Look for no garbage while modules are imported.

    Imports make some 150,000 objects and hardly any garbage; looking for it took a tenth of the time up to the first
    result.

    Args:
        for_good: Whether later searches leave out what was imported, as where it stays until the process ends.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if for_good:
            gc.freeze()
        if was_enabled:
            gc.enable()


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    with contextlib.suppress(OSError):  # a closed standard error hears nothing
        os.write(2, b"voxjax: stopped.\n")
    os._exit(128 + number)


def _raise_stopped(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_IGN)  # a second one must not break the cleaning up
    raise Stopped(number)
