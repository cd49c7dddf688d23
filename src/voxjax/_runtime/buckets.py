"""The short ladder of shapes that host code pads to, so that a new map compiles nothing new."""

import numpy as np


def bucket_size(count: int, smallest: int = 64) -> int:
    """Return the smallest rung >= `count` of the ladder s, 1.5 s, 2 s, 3 s, 4 s, 6 s, ..."""
    rung = _first_rung(smallest)
    while rung < count:
        # There are two rungs for each doubling: padding is at most a third of what is computed.
        if rung * 3 // 2 >= count:
            return rung * 3 // 2
        rung *= 2
    return rung


def wide_bucket_size(count: int, smallest: int) -> int:
    """Return the smallest of s, 4 s, 16 s, ... that is >= `count`: for short lists, where a compilation costs more."""
    rung = _first_rung(smallest)
    while rung < count:
        rung *= 4
    return rung


def _first_rung(smallest: int) -> int:
    # From 0 a ladder never climbs, and its callers would wait forever.
    if smallest < 1:
        raise ValueError(f"smallest must be 1 or more, got {smallest}.")
    return smallest


def pad_rows(rows: np.ndarray, size: int, fill: float | int | np.ndarray = 0) -> np.ndarray:
    """Return `rows` with rows of `fill` (a number, or one whole row) appended up to `size` rows, same dtype."""
    # NumPy's own `pad` knows one number for all columns, and a row of padding may have to be a whole matrix.
    padded = np.full((size, *rows.shape[1:]), fill, dtype=rows.dtype)
    padded[: len(rows)] = rows
    return padded
