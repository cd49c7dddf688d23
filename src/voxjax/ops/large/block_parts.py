"""Where a block array is cut into parts, and what each part holds: host code, the same in all processes.

Blocks are numbered in C order over the box, and a part is a run of numbers: neighbours along z and y follow each
other, and parts meet across x alone. Two of them have fewer blocks that touch other parts than along a Morton curve,
eight about as many or up to twice as many, and more of them more; but runs need no code of their own in a lookup: the
table of a part is a piece of the table of the box.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, Int32, Shaped

from ..blocks.block_array import BlockArray


class Part(NamedTuple):
    """What one part holds, in rows of the whole array's pool.

    Attributes:
        low: Number of its first block that is not all 0.
        high: One past the number of its last one; `low` where the part is empty.
        listed: Numbers of its own blocks that hold the value asked for, int64, ascending.
        numbers: Numbers of all blocks that the part looks at and that are not all 0, int64: its own ones, and those
            that touch a listed one.
        rows: Row of the whole pool of each of these.
        levels: Values of the rows of the part's pool that hold one value, after the one of zeros.
        mixed: Rows of the whole pool that follow them, ascending.
    """

    low: int
    high: int
    listed: Int[np.ndarray, "m"]
    numbers: Int[np.ndarray, "n"]
    rows: Int32[np.ndarray, "n"]
    levels: Shaped[np.ndarray, " v"]
    mixed: Int[np.ndarray, "w"]

    @property
    def first(self) -> int:
        """Number of the block with which the part's table begins."""
        return int(self.numbers.min(initial=self.low))

    @property
    def num_entries(self) -> int:
        """Length of the part's table."""
        return int(self.numbers.max(initial=self.first - 1)) + 1 - self.first

    @property
    def num_rows(self) -> int:
        """Rows of the part's pool."""
        return 1 + len(self.levels) + len(self.mixed)


def cut_parts(array: BlockArray, num_parts: int, value: int) -> Iterator[Part]:
    """Cut an array into parts that hold equally many blocks with some voxel of a value.

    Args:
        array: The array.
        num_parts: Number of parts; those that are left over where there are fewer blocks are empty.
        value: The value, not 0.

    Yields:
        The parts, in the order of their blocks. Together they own each block that is not all 0 once.
    """
    lattice, flat = array.table.shape, np.asarray(array.table).reshape(-1)
    places = array.places(_holds(np.asarray(array.pool), value))
    listed = np.asarray(np.ravel_multi_index(tuple(places.T), lattice), np.int64)
    ends = np.arange(num_parts + 1) * len(listed) // num_parts
    # Blocks without the value belong to the part of the last listed one before them, and the first ones to the first.
    bounds = [0, *np.append(listed, len(flat))[ends[1:-1]].tolist(), len(flat)]
    for start, stop, begin, end in zip(bounds[:-1], bounds[1:], ends[:-1], ends[1:], strict=True):
        yield _part_of(array, flat, _filled(flat, start, stop), listed[begin:end], start)


def _part_of(array: BlockArray, flat: np.ndarray, own: np.ndarray, listed: np.ndarray, start: int) -> Part:
    """The part that owns some blocks, by their numbers, ascending."""
    low, high = (int(own[0]), int(own[-1]) + 1) if len(own) else (start, start)
    around = _touched(listed, array.table.shape, low, high)
    numbers = np.concatenate([own, around[flat[around] != 0]])
    rows = flat[numbers]
    is_used = np.zeros(len(array.pool), bool)
    is_used[rows] = True
    level = np.asarray(array.pool[is_used & array.is_uniform, 0, 0, 0])
    return Part(
        low,
        high,
        listed,
        numbers,
        rows,
        np.unique(level[level != 0]),
        np.flatnonzero(is_used & ~array.is_uniform),
    )


def table_of(part: Part, array: BlockArray, out: Int32[np.ndarray, "n"]) -> None:
    """Write the table of a part: the row in its own pool of each block from the first one on.

    Args:
        part: The part.
        array: The whole array.
        out: Zeros, at least as many as the part has entries.
    """
    own = np.zeros(len(array.pool), np.int32)
    level = np.flatnonzero(array.is_uniform)
    # Where a value is 0 the row stays 0.
    values = np.asarray(array.pool[level, 0, 0, 0])
    at = np.searchsorted(part.levels, values)
    is_there = np.append(part.levels, np.zeros(1, part.levels.dtype))[at] == values
    own[level] = np.where(is_there & (values != 0), at + 1, 0)
    own[part.mixed] = np.arange(1 + len(part.levels), part.num_rows, dtype=np.int32)
    out[part.numbers - part.first] = own[part.rows]


def pool_of(part: Part, array: BlockArray, out: Shaped[np.ndarray, "n 8 8 8"]) -> None:
    """Write the pool of a part: a row of zeros, the blocks of one value, the others.

    Args:
        part: The part.
        array: The whole array.
        out: Zeros, at least as many rows as the part has.
    """
    start = 1 + len(part.levels)
    out[1:start] = part.levels[:, None, None, None]
    np.take(np.asarray(array.pool), part.mixed, axis=0, out=out[start : part.num_rows])


def _holds(pool: Shaped[np.ndarray, "n 8 8 8"], value: int) -> Bool[np.ndarray, "n"]:
    """Whether some voxel of each row holds a value."""
    step = 1 << 13
    parts = (pool[start : start + step] == value for start in range(0, len(pool), step))
    return np.concatenate([part.any(axis=(1, 2, 3)) for part in parts])


def _filled(flat: Int32[np.ndarray, "n"], start: int, stop: int) -> Int[np.ndarray, "m"]:
    """Where a piece of a table is not 0, int64."""
    # A few million at a time: most of a large table was never written, and what is made of it is not to take memory.
    step = 1 << 22
    found = [np.zeros(0, np.int64)]
    found += [np.flatnonzero(flat[low : min(low + step, stop)]) + low for low in range(start, stop, step)]
    return np.concatenate(found)


def _touched(
    listed: Int[np.ndarray, "m"], lattice: tuple[int, ...], low: int, high: int
) -> Int[np.ndarray, "n"]:
    """Numbers of the blocks outside of a run of numbers that touch a listed block, also by a corner."""
    _, b, c = lattice
    # No neighbour is farther away in C order.
    reach = b * c + c + 1
    near = listed[(listed < low + reach) | (listed >= high - reach)]
    places = np.stack(np.unravel_index(near, lattice), axis=1)
    around = np.concatenate([places + np.asarray(step) - 1 for step in np.ndindex(3, 3, 3)])
    around = around[((around >= 0) & (around < lattice)).all(axis=1)]
    numbers = np.unique(np.ravel_multi_index(tuple(around.T), lattice))
    return numbers[(numbers < low) | (numbers >= high)]
