"""`ChunkedArray`: an array over a box of voxels that lies elsewhere in chunks, of which those are read that are needed.

It answers what a `BlockArray` answers. Windows and single voxels are read chunk by chunk, and the chunks read last are
kept, up to a bound; what needs all voxels passes over the chunks one after another, or reads them into blocks.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Int, Int32, Shaped

from ..._checks import InputError
from ..._runtime.memory import check_memory, memory_limit
from ..._runtime.threads import num_cores, spread
from .block_array import BLOCK_VOXELS, BlockArray, Corner, Shape, is_uniform
from .block_builder import BlockBuilder, split
from .windows import cut_out
from .words import BLOCK

T = TypeVar("T")
Reader = Callable[[tuple[int, int, int]], np.ndarray]

_ADVICE = "crop the map, or take a larger voxel size"


class Survey(NamedTuple):
    """What one pass over all chunks tells.

    Attributes:
        counts: int64 (256,): how many voxels of the box hold each value of uint8, 0 left out.
        low: Lowest voxel that is not 0, int64 (3,).
        high: One past the highest, int64 (3,); both 0 where all are.
        num_blocks: Number of blocks of the box that do not hold one value alone.
    """

    counts: Int[np.ndarray, "256"]
    low: Int[np.ndarray, "3"]
    high: Int[np.ndarray, "3"]
    num_blocks: int


class ChunkedArray:
    """Values of the voxels of a box, read as they are asked for; several threads may ask at once.

    Attributes:
        shape: Number of voxels along x, y, z.
        dtype: Kind of number that a voxel holds.
        chunk: Number of voxels of a chunk along x, y, z; those at the end of the box hold what lies in it.
        known: bool (a, b, c): which chunks may hold something that is not 0.
    """

    def __init__(
        self,
        shape: Shape,
        dtype: np.typing.DTypeLike,
        chunk: Shape,
        known: Bool[np.ndarray, "a b c"],
        read: Reader,
        *,
        most_kept: int = 1 << 26,
    ) -> None:
        """Begin with nothing read.

        Args:
            shape: Number of voxels along x, y, z.
            dtype: Kind of number that a voxel holds.
            chunk: Number of voxels of a chunk.
            known: Which chunks are there to read.
            read: Gives the chunk at a place of `known`, cut to the box; called from several threads.
            most_kept: Memory of chunks that are kept for the next window, at most [byte].
        """
        self.shape, self.dtype, self.chunk, self.known = shape, np.dtype(dtype), chunk, known
        self._read, self._most_kept = read, most_kept
        self._kept: OrderedDict[tuple[int, int, int], np.ndarray] = OrderedDict()
        self._lock = threading.Lock()
        self._whole: BlockArray | None = None

    def __getstate__(self) -> dict:
        """What another process is given: no chunk, each reads those that it needs."""
        return vars(self) | {"_kept": OrderedDict(), "_lock": None, "_whole": None}

    def __setstate__(self, state: dict) -> None:
        """Begin with nothing read."""
        vars(self).update(state, _lock=threading.Lock())

    @property
    def num_voxels(self) -> int:
        """Number of voxels of the box."""
        x, y, z = self.shape
        return x * y * z

    @property
    def is_surveyed(self) -> bool:
        """Whether counts and the known box are there without reading all chunks."""
        return self._whole is not None or "survey" in vars(self)

    def __array__(self, dtype: np.typing.DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        """The dense array, as NumPy asks for it."""
        return np.asarray(self.dense(), dtype)

    def dense(self) -> np.ndarray:
        """All voxels of the box, (x, y, z).

        Raises:
            InputError: If there is not enough memory for the box.
        """
        size = float(self.num_voxels) * self.dtype.itemsize
        if size > 1 << 24:  # a smaller one is not worth the milliseconds of asking
            box = " x ".join(map(str, self.shape))
            check_memory(size, f"the dense array of {box} voxels", _ADVICE, on_device=False)
        return self.window((0, 0, 0), self.shape)

    def view(self) -> np.ndarray:
        """`dense`, but read-only: what somebody writes there would not reach the store."""
        found = self.dense()
        found.flags.writeable = False
        return found

    def window(self, low: Corner, high: Corner) -> np.ndarray:
        """Voxels from `low` up to and without `high`, dense; 0 beyond the box.

        Args:
            low: Lowest voxel, which may lie outside.
            high: One past the highest.

        Raises:
            InputError: If this process may not take the memory for it.
        """
        if self._whole is not None:
            return self._whole.window(low, high)
        first, last = np.asarray(low, np.int64), np.asarray(high, np.int64)
        with _memory_named(first, last):
            found = np.zeros(np.maximum(last - first, 0), self.dtype)
        for place in self._places(np.maximum(first, 0), np.minimum(last, self.shape)):
            begin = place * self.chunk
            values = self._chunk(place)
            inner_low = np.maximum(begin, first)
            inner_high = np.minimum(begin + values.shape, last)
            target = tuple(map(slice, inner_low - first, inner_high - first))
            found[target] = values[tuple(map(slice, inner_low - begin, inner_high - begin))]
        return found

    def take(self, index: Int[np.ndarray, "m 3"]) -> Shaped[np.ndarray, " m"]:
        """Values at voxels inside the box."""
        if self._whole is not None:
            return self._whole.take(index)
        place, cell = np.divmod(index, self.chunk)
        number = np.asarray(np.ravel_multi_index(tuple(place.T), self.known.shape))
        found = np.zeros(len(index), self.dtype)
        # Voxels of a chunk together: each is read once.
        order = number.argsort(kind="stable")
        ends = np.flatnonzero(np.diff(number[order])) + 1
        for rows in np.split(order, ends) if len(order) else ():
            if self.known[tuple(place[rows[0]])]:
                found[rows] = self._chunk(place[rows[0]])[tuple(cell[rows].T)]
        return found

    def count(self, value: int | np.integer) -> int:
        """How many voxels of the box hold a value that is not 0, of an array of uint8."""
        return self._whole.count(value) if self._whole is not None else int(self.survey.counts[value])

    def known_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest voxel that is not 0, and one past the highest, int64 (3,) each; both 0 where all are."""
        return self._whole.known_box() if self._whole is not None else (self.survey.low, self.survey.high)

    def where(self, value: int | np.integer) -> Int32[np.ndarray, "m 3"]:
        """Voxels that hold a value that is not 0, int32 (m, 3), in lexicographic order; no more than the list is kept.

        Raises:
            InputError: If there is not enough memory for the list.
        """
        if self._whole is not None:
            return self._whole.where(value)
        count = self.count(value)
        if count > 1 << 22:  # a short list is not worth the milliseconds of asking
            check_memory(36.0 * count, f"the list of {count:,} voxels", _ADVICE, on_device=False)
        found: list[np.ndarray] = [np.zeros((0, 3), np.int32)]
        layer: list[np.ndarray] = []
        begin = 0
        for low, index in self._parts(lambda values: np.argwhere(values == value)):
            # Pieces come layer by layer along x, in which a sort puts their voxels in order.
            if layer and low[0] > begin:
                found.append(_in_order(layer))
                layer = []
            begin = low[0]
            layer.append((index + low).astype(np.int32))
        return np.concatenate([*found, _in_order(layer)]) if layer else found[0]

    def blocks(self) -> BlockArray:
        """The array in blocks, read whole and kept from then on.

        Raises:
            InputError: If there is not enough memory for the blocks.
        """
        if self._whole is None:
            self._check_room()
            whole = self._gathered(np.zeros(3, np.int64), np.asarray(self.shape, np.int64))
            with self._lock:
                self._whole = whole
                self._kept.clear()
        return self._whole

    def cut(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> "ChunkedArray | BlockArray":
        """The part from voxel `low` up to and without `high`, both inside the box: read, but for the whole."""
        low, high = np.asarray(low, np.int64), np.asarray(high, np.int64)
        if not low.any() and tuple(high.tolist()) == self.shape:
            return self
        if self._whole is not None:
            return cut_out(self._whole, low, high)
        first = low // self._piece * self._piece
        last = np.minimum(-(-high // self._piece) * self._piece, self.shape)
        return cut_out(self._gathered(first, last), low - first, high - first)

    @cached_property
    def survey(self) -> Survey:
        """Counts and the known box, from one pass over all chunks, of which none is kept."""
        counts, num_blocks = np.zeros(256, np.int64), 0
        low, high = np.asarray(self.shape, np.int64), np.zeros(3, np.int64)
        for first, (some, begin, end, blocks) in self._parts(_surveyed):
            counts += some
            low, high = np.minimum(low, first + begin), np.maximum(high, first + end)
            num_blocks += blocks
        return Survey(counts, np.where(high > 0, low, 0), high, num_blocks)

    @property
    def _piece(self) -> Int[np.ndarray, "3"]:
        """Sides of the pieces of whole blocks that a pass takes: a chunk, as a rule."""
        return -(-np.asarray(self.chunk, np.int64) // BLOCK) * BLOCK

    def _check_room(self) -> None:
        """Refuse to read the whole where its blocks do not fit."""
        limit = memory_limit(on_device=False)
        of_block = 2.0 * BLOCK_VOXELS * self.dtype.itemsize  # the blocks, and the pool that they are put into
        most = of_block * np.count_nonzero(self.known) * float(np.prod(self._piece)) / BLOCK_VOXELS
        # Chunks hold far fewer blocks than have room in them: where these would not fit, they are counted.
        if limit is not None and most > limit:
            size = " x ".join(map(str, self.shape))
            what = f"the map of {size} voxels, read whole,"
            check_memory(of_block * self.survey.num_blocks, what, _ADVICE, on_device=False)

    def _gathered(self, first: Int[np.ndarray, "3"], last: Int[np.ndarray, "3"]) -> BlockArray:
        """The blocks of a window that begins with a piece, and ends with one or with the box."""
        with _memory_named(first, last):
            builder = BlockBuilder(tuple((last - first).tolist()), self.dtype)
            for low, (index, blocks) in self._parts(split, first, last):
                builder.add(index + (low - first) // BLOCK, blocks)
            return builder.finish()

    def _parts(
        self,
        function: Callable[[np.ndarray], T],
        first: Int[np.ndarray, "3"] | None = None,
        last: Int[np.ndarray, "3"] | None = None,
    ) -> Iterator[tuple[Int[np.ndarray, "3"], T]]:
        """What a function makes of the pieces that hold something, a few side by side.

        Args:
            function: Gets the values of a piece.
            first: Where the pieces begin; None for all of the box.
            last: One past their highest voxel.

        Yields:
            The lowest voxel of a piece, in lexicographic order, and the function's result.
        """
        first = np.zeros(3, np.int64) if first is None else first
        last = np.asarray(self.shape, np.int64) if last is None else last
        begin = self._places(first, last) * self.chunk
        end = np.minimum(begin + self.chunk, self.shape) - 1
        # A chunk meets two pieces along an axis at most, which are as wide as it is or wider.
        met = [np.where(sides, end, begin) // self._piece for sides in np.ndindex(2, 2, 2)]
        lows = np.unique(np.concatenate(met), axis=0) * self._piece
        lows = lows[((lows >= first) & (lows < last)).all(axis=1)]

        def of_piece(low: np.ndarray) -> T | None:
            high = np.minimum(low + self._piece, last)
            values = self.window(low, high)
            with _memory_named(low, high):
                return function(values) if values.any() else None

        step = 4 * num_cores()
        for start in range(0, len(lows), step):
            some = lows[start : start + step]
            for low, result in zip(some, spread(of_piece, some), strict=True):
                if result is not None:
                    yield low, result

    def _places(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> Int[np.ndarray, "m 3"]:
        """Known chunks that meet a window of the box, in lexicographic order."""
        if (high <= low).any():
            return np.zeros((0, 3), np.int64)
        first = low // self.chunk
        return np.argwhere(self.known[tuple(map(slice, first, -(-high // self.chunk)))]) + first

    def _chunk(self, place: Int[np.ndarray, "3"]) -> np.ndarray:
        """A chunk, from those that were read last or from where it lies."""
        x, y, z = place.tolist()
        with self._lock:
            values = self._kept.get((x, y, z))
            if values is not None:
                self._kept.move_to_end((x, y, z))
                return values
        # Others go on meanwhile; two threads may read one chunk, which harms nobody.
        values = self._read((x, y, z))
        with self._lock:
            self._kept[x, y, z] = values
            most = self._most_kept // (int(np.prod(self.chunk)) * self.dtype.itemsize)
            while len(self._kept) > max(most, 1):
                self._kept.popitem(last=False)
        return values


@contextmanager
def _memory_named(low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> Iterator[None]:
    """Say what the memory was for that this process may not take: the limit of a shell or of a batch job.

    Raises:
        InputError: In place of a `MemoryError` within the block.
    """
    try:
        yield
    except MemoryError as error:
        size = " x ".join(map(str, (high - low).tolist()))
        raise InputError(
            f"a window of {size} voxels needs more memory than this process may take; {_ADVICE}."
        ) from error


def _surveyed(values: Shaped[np.ndarray, "x y z"]) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Counts of values of uint8, the box of what is not 0, and how many blocks are not of one value."""
    counts = np.zeros(256, np.int64)
    if values.dtype == np.uint8:
        counts = np.bincount(values.reshape(-1), minlength=256)
        counts[0] = 0
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    is_known = values != 0
    for axis in range(3):
        hit = np.flatnonzero(is_known.any(axis=tuple(other for other in range(3) if other != axis)))
        low[axis], high[axis] = hit[0], hit[-1] + 1
    return counts, low, high, int(np.count_nonzero(~is_uniform(split(values)[1])))


def _in_order(parts: list[np.ndarray]) -> Int32[np.ndarray, "m 3"]:
    """Lists of voxels as one, in lexicographic order."""
    index = np.concatenate(parts)
    return index[np.lexsort(index.T[::-1])]
