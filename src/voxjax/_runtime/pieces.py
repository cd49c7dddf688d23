"""Lists of any length through kernels of one size: cut, pad, call, cut off what was padded, concatenate.

A list of any length compiles nothing new, what a piece computes stays in the cache of a core, memory does not grow
with the length of the list, and the pieces run side by side on all cores.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float32, Float64

from .._types import Array
from .buckets import pad_rows
from .threads import num_cores, spread

R = TypeVar("R")

PIECES = (128, 512, 1024, 4096, 16384)
"""Points of a piece of `sum_over_pieces`: the smallest size that holds the list, else the largest."""

POSES = 512
"""Poses of a piece at most; how many of them there are is no part of its shape."""


Run = Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]]
"""A way to call a function for each of many items: `spread`, or `one_by_one` to spare memory."""


def one_by_one(function: Callable[[Any], R], items: Iterable[Any]) -> list[R]:
    """`function` of each item in the calling thread: for kernels that take much memory or use all cores themselves."""
    return [function(item) for item in items]


def each_piece(
    function: Callable[..., R],
    lists: Sequence[np.ndarray],
    *,
    size: int,
    step: int | None = None,
    fills: Sequence[Any] | None = None,
    run: Run = spread,
) -> list[R]:
    """Call a function for each piece of some lists of equal length.

    Args:
        function: Called with the rows of a piece from each list, padded to `size`, and the number of rows that count
            (int32).
        lists: One row an item each.
        size: Rows that the function sees.
        step: Rows that count in each piece but the last, at most `size`; None for `size`. Less makes more pieces, so
            that each core has one.
        fills: What a padding row of each list holds, 0 unless given.
        run: Calls pieces side by side, or one after the other.

    Returns:
        What the function gave, in the order of the pieces; lists without rows make one piece of padding alone.
    """
    step = size if step is None else step
    fills = [0] * len(lists) if fills is None else fills

    def call(first: int) -> R:
        some = [rows[first : first + step] for rows in lists]
        padded = [
            rows if len(rows) == size else pad_rows(rows, size, fill)
            for rows, fill in zip(some, fills, strict=True)
        ]
        # The number of rows is an array, not a Python number: it may differ from call to call without a new kernel.
        return function(*padded, np.int32(len(some[0])))

    return run(call, range(0, max(len(lists[0]), 1), step))


def over_pieces(
    kernel: Callable[..., Any],
    lists: Sequence[np.ndarray],
    *,
    size: int,
    step: int | None = None,
    fills: Sequence[Any] | None = None,
    run: Run = spread,
) -> Any:
    """What a kernel gives for each row of some lists of equal length.

    Args:
        kernel: A function as `each_piece` takes it, which gives an array, or a tree of arrays, of `size` rows. Rows of
            padding may hold anything.
        lists: Arrays of equal length, of which each piece is given as many rows.
        size: Rows that the kernel sees.
        step: Rows that count in each piece.
        fills: What a padding row of each list holds.
        run: Calls pieces side by side, or one after the other.

    Returns:
        NumPy arrays, one row an item, in the structure of what the kernel gives.
    """

    def cut(*piece: Any) -> Any:
        # A piece is fetched in its own thread, so that waiting for it holds up no other.
        return jax.tree.map(lambda rows: np.asarray(rows)[: piece[-1]], kernel(*piece))

    parts = each_piece(cut, lists, size=size, step=step, fills=fills, run=run)
    return jax.tree.map(lambda *rows: np.concatenate(rows), *parts)


def over_poses(
    kernel: Callable[[np.ndarray, np.int32], Array], poses: Float32[np.ndarray, "k 4 4"], *, least_jobs: int
) -> np.ndarray:
    """What a kernel gives for each of any number of poses.

    Args:
        kernel: From poses (512, 4, 4) and the number of those that count to an array of 512 rows.
        poses: At least one.
        least_jobs: Cut them into at least so many calls, if there are so many poses: each core is to have one.

    Returns:
        One row a pose.
    """
    return over_pieces(kernel, [poses], size=POSES, step=_group_size(poses, least_jobs))


def sum_over_pieces(
    kernel: Callable[..., Array],
    lists: Sequence[np.ndarray],
    poses: Float32[np.ndarray, "k 4 4"],
    *,
    most: int = PIECES[-1],
    least_lookups: int = 1 << 19,
) -> Float64[np.ndarray, "k m"]:
    """Sums over all points for each pose.

    Args:
        kernel: From lists of one of the lengths `PIECES` or `most`, poses (512, 4, 4), their number to sums (512, m).
            Rows of zeros in the lists must add nothing.
        lists: float32, one row a point each.
        poses: Any number of poses.
        most: Points of a piece at most.
        least_lookups: Points times poses of a call at least, if one call is not enough: none shall be done before
            another thread has begun.

    Returns:
        float64: sums of what the pieces give, in their order, whatever the number of cores.
    """
    length = len(lists[0])
    size = min(next((piece for piece in PIECES if piece >= length), most), most)
    num_pieces = max(-(-length // size), 1)
    # As many calls as keep all cores busy, and no more: a call costs as much as some thousand lookups.
    num_calls = min(2 * num_cores(), -(-length * len(poses) // least_lookups))
    step = _group_size(poses, -(-num_calls // num_pieces))
    groups = [poses[first : first + step] for first in range(0, len(poses), step)]

    def sums_of(job: tuple[tuple[Any, ...], np.ndarray]) -> np.ndarray:
        (*piece, _), group = job
        return over_pieces(partial(kernel, *piece), [group], size=POSES)

    # Each piece is padded once, however many groups of poses meet it.
    padded = each_piece(lambda *piece: piece, lists, size=size, run=one_by_one)
    found = spread(sums_of, product(padded, groups))
    # `product` has all groups of poses of one piece before those of the next.
    sums = [np.concatenate(found[k : k + len(groups)]) for k in range(0, len(found), len(groups))]
    # The order of the pieces is fixed, so that the number of cores changes no bit.
    return np.stack(sums).sum(axis=0, dtype=np.float64)


def _group_size(poses: np.ndarray, least: int) -> int:
    """Poses of a group: at most `POSES`, and so few that there are `least` groups if there are so many poses."""
    return max(min(-(-len(poses) // least), POSES), 1)
