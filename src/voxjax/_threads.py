"""Independent pieces of work side by side: NumPy, SciPy and XLA let other threads run while they compute."""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def num_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


_inside = threading.local()


def spread(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """`function` of each item, in their order, on all cores; the first error is raised once all have ended.

    Pieces of a piece run one after the other: the cores are busy already. The calling thread takes none: a trace that
    it is in, and settings of JAX that hold for it alone (float64), would reach some of the pieces and not others.
    """
    if getattr(_inside, "is_piece", False):
        return [function(item) for item in items]
    with ThreadPoolExecutor(num_cores(), initializer=_begin) as pool:
        return list(pool.map(function, items))


def _begin() -> None:
    _inside.is_piece = True
