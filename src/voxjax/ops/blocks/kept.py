"""What a map is kept as, and the same questions to each: a dense array, its blocks, or chunks that are read as needed.

Dense arrays may lie on a device, from which they are fetched; `BlockArray` and `ChunkedArray` answer for themselves.
"""

import math

import numpy as np
from jaxtyping import Bool, Int, Int32, Shaped

from ..._runtime.memory import check_memory
from ..._types import Array
from .block_array import BlockArray, Corner
from .block_builder import blocks_of
from .chunked_array import ChunkedArray
from .windows import cut_out
from .words import BLOCK

Sparse = BlockArray | ChunkedArray
"""What is kept of maps whose box may be of any size."""

Kept = Array | Sparse


def in_blocks(kept: Kept) -> BlockArray:
    """The blocks; those of a dense array are made at each call, those of a store are read once and kept."""
    if isinstance(kept, ChunkedArray):
        return kept.blocks()
    return kept if isinstance(kept, BlockArray) else blocks_of(np.asarray(kept))


def checkable(kept: Kept) -> Array:
    """All values that there are, each once at least; of a store none, whose reader looks at what it reads."""
    if isinstance(kept, ChunkedArray):
        return np.zeros(0, kept.dtype)
    return kept.pool if isinstance(kept, BlockArray) else kept


def window(kept: Kept, low: Corner, high: Corner) -> Shaped[np.ndarray, "x y z"]:
    """A window, dense: from voxel `low` up to and without `high`, both inside the box."""
    if isinstance(kept, Sparse):
        return kept.window(low, high)
    return np.asarray(kept)[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]


def part(kept: Kept, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> Kept:
    """A window as an array of its own: of a dense array a view, of a store what is read for it."""
    if isinstance(kept, ChunkedArray):
        return kept.cut(low, high)
    return cut_out(kept, low, high) if isinstance(kept, BlockArray) else window(kept, low, high)


def take(kept: Kept, index: Int[np.ndarray, "n 3"]) -> Shaped[np.ndarray, " n"]:
    """Values of voxels inside the box."""
    return kept.take(index) if isinstance(kept, Sparse) else np.asarray(kept)[tuple(index.T)]


def count(kept: Kept, value: np.uint8) -> int:
    """How many voxels hold a value that is not 0."""
    if isinstance(kept, Sparse):
        return kept.count(value)
    # In pieces that stay in the cache, without an array of truth values as large as the map.
    flat, piece = np.asarray(kept).reshape(-1), 1 << 18
    starts = range(0, flat.size, piece)
    return sum(int(np.count_nonzero(flat[start : start + piece] == value)) for start in starts)


def where(kept: Kept, value: np.uint8, what: str) -> Int32[np.ndarray, "n 3"]:
    """Voxels that hold a value that is not 0, in lexicographic order.

    Args:
        kept: The array.
        value: The value.
        what: What such voxels are called where there is not enough memory for the list.

    Raises:
        InputError: If there is not.
    """
    if isinstance(kept, Sparse):
        return kept.where(value)
    states, total = np.asarray(kept), count(kept, value)
    if total > 1 << 22:  # a short list is not worth the milliseconds of asking
        advice = "crop the map, or take a larger voxel size"
        check_memory(12.0 * total, f"the list of {total:,} {what} voxels", advice, on_device=False)
    index, start = np.empty((total, 3), np.int32), 0
    # A few planes at a time: NumPy's own indices are int64, several times as large as the list. They are looked for
    # in a flat block, for along three axes NumPy takes ten times as long.
    planes = max((1 << 20) // max(math.prod(states.shape[1:]), 1), 1)
    for first in range(0, len(states), planes):
        block = states[first : first + planes].reshape(-1)
        places = np.flatnonzero(block == value)
        rows = index[start : start + len(places)]
        places, rows[:, 2] = np.divmod(places, states.shape[2])
        rows[:, 0], rows[:, 1] = np.divmod(places, states.shape[1])
        rows[:, 0] += first
        start += len(rows)
    return index


def known_box(kept: Kept) -> tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]:
    """Lowest voxel that is not 0, and one past the highest, int64 (3,) each; both 0 where all are."""
    if isinstance(kept, Sparse):
        return kept.known_box()
    states = np.asarray(kept)
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    if not states.size:
        return low, high
    # The greatest along an axis takes no list of truth values as large as the map.
    over_x = states.max(axis=0)
    for axis, greatest in enumerate((states.max(axis=(1, 2)), over_x.max(axis=1), over_x.max(axis=0))):
        hit = np.flatnonzero(greatest)
        low[axis], high[axis] = (hit[0], hit[-1] + 1) if hit.size else (0, 0)
    return low, high


def same(one: Kept | None, other: Kept | None) -> bool:
    """Whether two arrays of one shape hold the same values, however they are kept."""
    if one is None or other is None:
        return one is other
    if isinstance(one, Sparse) or isinstance(other, Sparse):
        return in_blocks(one).equals(in_blocks(other))
    return np.array_equal(np.asarray(one), np.asarray(other))


def cubes_of(kept: Kept, side: int) -> Bool[np.ndarray, "a b c"]:
    """Which cubes of a box may hold something that is not 0; of a dense array all.

    Args:
        kept: The array.
        side: Sides of the cubes [voxel], which are whole blocks.
    """
    lattice = tuple(-(-n // side) for n in kept.shape)
    if isinstance(kept, BlockArray):
        found = np.zeros(lattice, bool)
        found[tuple(np.argwhere(np.asarray(kept.table) != 0).T // (side // BLOCK))] = True
    elif isinstance(kept, ChunkedArray):
        found = np.zeros(lattice, bool)
        lows = np.argwhere(kept.known) * kept.chunk
        if not (side % np.asarray(kept.chunk)).any():  # no chunk meets two cubes
            found[tuple((lows // side).T)] = True
            return found
        for low in lows:
            found[tuple(map(slice, low // side, -(-(low + kept.chunk) // side)))] = True
    else:
        found = np.ones(lattice, bool)
    return found
