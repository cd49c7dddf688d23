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

    The first signal ends the process, whose exit code is that of this one: further signals are ignored, from then until
    the process has ended, lest they break the cleaning up. Without a signal all handlers are put back.

    Only the main thread may handle signals; in another one nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {}
    is_stopped = False

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        nonlocal is_stopped
        is_stopped = True
        # Python complains about a signal that is pending when it becomes ignored, but not about an idle handler.
        # All of them are replaced, not only the one that came: one of another kind would cut the cleaning up
        # short.
        for each in before:
            signal.signal(each, _do_nothing)
        raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)

    try:
        for number in _unclaimed_signals():
            before[number] = signal.getsignal(number)
            signal.signal(number, stop)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if is_stopped else handler)


@contextlib.contextmanager
def garbage_collection_put_off(*, for_good: bool) -> Iterator[None]:
    """Look for no garbage while modules are imported.

    Imports make some 150,000 objects and hardly any garbage; looking for it took a tenth of the time up to the first
    result.

    Args:
        for_good: Whether later searches leave out what was imported, as where it stays until the process ends.
    """
    # The caller's choice is put back as it was, also where they had switched the search off.
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


def _unclaimed_signals() -> list[signal.Signals]:
    """Signals that ask the process to end, but for those that are ignored, as under nohup, or that someone handles."""
    names = [
        name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
    ]  # Windows has no SIGHUP
    unclaimed = (signal.SIG_DFL, signal.default_int_handler, _leave)
    return [signal.Signals[name] for name in names if signal.getsignal(signal.Signals[name]) in unclaimed]


def _do_nothing(number: int, frame: FrameType | None) -> None:
    """Handler of the signals after the first."""
