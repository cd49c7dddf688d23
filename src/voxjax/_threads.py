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

    The calling thread takes its share, so that two pieces on two cores begin one thread only. Pieces of a piece run
    one after the other: the cores are busy already.
    """
    items = list(items)
    num_helpers = min(num_cores(), len(items)) - 1
    if num_helpers < 1 or getattr(_inside, "is_piece", False):
        return [function(item) for item in items]
    places = iter(range(len(items)))  # shared: each thread takes the next one
    results: dict[int, R] = {}
    errors: dict[int, Exception] = {}

    def take() -> None:
        _inside.is_piece = True
        try:
            for place in places:
                try:
                    results[place] = function(items[place])
                except Exception as error:
                    errors[place] = error
        finally:
            _inside.is_piece = False

    with ThreadPoolExecutor(num_helpers) as pool:
        helpers = [pool.submit(take) for _ in range(num_helpers)]
        try:
            take()
        except BaseException:
            for _ in places:  # an interrupt: what has not begun is left
                pass
            raise
    for helper in helpers:
        helper.result()
    if errors:
        raise errors[min(errors)]
    return [results[place] for place in range(len(items))]
