"""Checks of the calls that the modules of rows compare: equal results, temporary memory."""

from collections.abc import Callable

import numpy as np


def check_equal(calls: list[Callable[[], object]]) -> None:
    """Raise if the results of two calls differ."""
    first = np.asarray(calls[0]())
    for call in calls[1:]:
        np.testing.assert_array_equal(np.asarray(call()), first)


def temporary_bytes(compiled) -> int | None:
    """Bytes of temporary memory of a compiled call, where XLA says."""
    memory = compiled.memory_analysis()
    return None if memory is None else int(memory.temp_size_in_bytes)
