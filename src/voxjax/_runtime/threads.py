"""Independent pieces of work side by side: NumPy, SciPy and XLA let other threads run while they compute."""

import functools
import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def num_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


# `is_piece` is set in the threads of the pool alone: by it a piece knows that it is one.
_inside = threading.local()


def spread(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """`function` of each item, in their order, on all cores; the first error is raised once all have ended.

    Pieces of a piece run one after the other: the cores are busy already. The calling thread takes none: a trace that
    it is in, and settings of JAX that hold for it alone (float64), would reach some of the pieces and not others.
    """
    if getattr(_inside, "is_piece", False):
        return [function(item) for item in items]
    # The cores are counted at each call, for a process may be given others while it runs.
    pool = _pool(num_cores())
    pieces = [pool.submit(function, item) for item in list(items)]  # all are known before the first begins
    try:
        return [piece.result() for piece in pieces]
    finally:
        for piece in pieces:
            # After an error, pieces that have not begun never do, and none is still at work when it is raised.
            piece.cancel()
        wait(pieces)


@functools.cache
def _pool(num_threads: int) -> ThreadPoolExecutor:
    """Threads that stay, for to begin some takes longer than many a kernel."""
    return ThreadPoolExecutor(num_threads, "voxjax pieces", initializer=_begin)


def _begin() -> None:
    _inside.is_piece = True


if hasattr(os, "register_at_fork"):
    # A forked process has none of the threads.
    os.register_at_fork(after_in_child=_pool.cache_clear)
