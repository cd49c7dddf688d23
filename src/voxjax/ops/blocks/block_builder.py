"""Block arrays put together from blocks, and from dense arrays."""

import numpy as np
from jaxtyping import Int, Int32, Shaped
from numpy.lib.stride_tricks import sliding_window_view

from ..._checks import InputError
from ..._runtime.tables import reserve
from ..._runtime.threads import spread
from .block_array import BlockArray, Shape, is_uniform, lattice_shape
from .words import BLOCK


class BlockBuilder:
    """A `BlockArray` that is put together from blocks, in any order, each block of the box once at most."""

    def __init__(self, shape: tuple[int, ...], dtype: np.typing.DTypeLike, *, capacity: int = 0) -> None:
        """Begin with zeros everywhere.

        Args:
            shape: Number of voxels along x, y, z.
            dtype: Kind of number that a voxel holds.
            capacity: How many different blocks there will be at most, where that is known: they are then written where
                they stay, and what is not written takes no memory.

        Raises:
            InputError: If the box has more blocks than int32 counts.
        """
        lattice = lattice_shape(shape)
        num_blocks = lattice[0] * lattice[1] * lattice[2]
        if num_blocks >= 1 << 31:
            box = " x ".join(f"{n:,}" for n in shape)
            raise InputError(
                f"a box of {box} voxels has {num_blocks:.3g} blocks of 8 x 8 x 8, more than 32 bits count; "
                "crop the map, or take a larger voxel size."
            )
        self._shape: Shape = tuple(int(n) for n in shape)  # pyright: ignore[reportAttributeAccessIssue]
        self._table = reserve(num_blocks, dtype=np.int32).reshape(lattice)
        # Row 0 is all zeros.
        self._pool = reserve(capacity + 1, BLOCK, BLOCK, BLOCK, dtype=dtype)
        self._more: list[np.ndarray] = []
        self._row_of = {self._pool.dtype.type(0).tobytes(): 0}
        self._length = 1

    def add(self, index: Int[np.ndarray, "m 3"], blocks: Shaped[np.ndarray, "m 8 8 8"]) -> None:
        """Put blocks at places of the table.

        Args:
            index: Places, each once.
            blocks: Their values; what lies beyond the box becomes 0.
        """
        if not len(index):
            return
        blocks = self._cut(index, np.ascontiguousarray(blocks, self._pool.dtype))
        level = is_uniform(blocks)
        rows = np.empty(len(blocks), np.int32)
        rows[level] = self._rows_of_values(blocks[level, 0, 0, 0])
        kept = blocks[~level]
        rows[~level] = np.arange(self._length, self._length + len(kept), dtype=np.int32)
        if len(kept):
            self._append(kept)
        self._table[tuple(np.asarray(index).T)] = rows

    def put(self, index: Int[np.ndarray, "m 3"], values: Shaped[np.ndarray, " m"]) -> None:
        """Put blocks of one value at places of the table.

        Args:
            index: Places, each once.
            values: Value of all voxels of each block that lie in the box.
        """
        reaches_out = ((np.asarray(index) + 1) * BLOCK > np.asarray(self._shape)).any(axis=1)
        if reaches_out.any():
            some = np.asarray(values)[reaches_out, None, None, None]
            self.add(index[reaches_out], np.broadcast_to(some, (len(some), BLOCK, BLOCK, BLOCK)))
            index, values = index[~reaches_out], values[~reaches_out]
        self._table[tuple(np.asarray(index).T)] = self._rows_of_values(np.asarray(values))

    def put_boxes(self, low: Int[np.ndarray, "m 3"], size: Shape, values: Shaped[np.ndarray, " m"]) -> None:
        """Put boxes of blocks of one value, which lie in the box as a whole, each voxel of them.

        Args:
            low: Lowest place of each in the table.
            size: Number of blocks along x, y, z, the same for all.
            values: Value of all voxels of each.
        """
        rows = self._rows_of_values(np.asarray(values))[:, None, None, None]
        sliding_window_view(self._table, size, writeable=True)[tuple(np.asarray(low).T)] = rows

    def levels_at(self, index: Int[np.ndarray, "m 3"]) -> Shaped[np.ndarray, " m"]:
        """Values of blocks as long as all that was put has one value each; 0 where nothing was."""
        values = np.concatenate([rows[:, 0, 0, 0] for rows in (self._pool, *self._more)])
        return values[self._table[tuple(np.asarray(index).T)]]

    def finish(self) -> BlockArray:
        """The array; the builder is not used any more."""
        pool = np.concatenate([self._pool, *self._more]) if self._more else self._pool[: self._length]
        return BlockArray(self._table, pool, self._shape)

    def _rows_of_values(self, values: np.ndarray) -> Int32[np.ndarray, " m"]:
        if values.dtype == np.uint8:  # of few values, which are counted faster than sorted
            row = np.zeros(256, np.int32)
            for value in np.flatnonzero(np.bincount(values, minlength=256)):
                row[value] = self._row_of_value(np.uint8(value))
            return row[values]
        different, at = np.unique(values, return_inverse=True)
        return np.asarray([self._row_of_value(value) for value in different], np.int32)[at]

    def _row_of_value(self, value: np.generic) -> int:
        key = value.tobytes()
        if key not in self._row_of:
            self._row_of[key] = self._length
            self._append(np.full((1, BLOCK, BLOCK, BLOCK), value))
        return self._row_of[key]

    def _append(self, blocks: np.ndarray) -> None:
        room = 0 if self._more else len(self._pool) - self._length
        if len(blocks) <= room:
            self._pool[self._length : self._length + len(blocks)] = blocks
        else:
            # Rows follow each other without a gap.
            self._pool = self._pool[: self._length] if not self._more else self._pool
            self._more.append(blocks)
        self._length += len(blocks)

    def _cut(self, index: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """Blocks with zeros beyond the box; only those at its end are changed, in a copy."""
        for axis, side in enumerate(self._shape):
            rest = side % BLOCK
            if rest:
                at_end = np.flatnonzero(np.asarray(index)[:, axis] == side // BLOCK)
                beyond = (
                    at_end,
                    *(slice(rest, None) if other == axis else slice(None) for other in range(3)),
                )
                if len(at_end) and blocks[beyond].any():
                    blocks = blocks.copy()
                    blocks[beyond] = 0
        return blocks


def split(
    values: Shaped[np.ndarray, "x y z"],
) -> tuple[Int[np.ndarray, "m 3"], Shaped[np.ndarray, "m 8 8 8"]]:
    """The blocks of a dense array that are not all 0: their places, and their values."""
    a, b, c = lattice_shape(values.shape)
    whole = BLOCK * a, BLOCK * b, BLOCK * c
    if values.shape != whole:
        values = np.pad(values, [(0, n - m) for n, m in zip(whole, values.shape, strict=True)])
    # Rows of a block move as one value each, in a third of the time.
    rows = np.ascontiguousarray(values).view(f"V{BLOCK * values.dtype.itemsize}")
    rows = np.ascontiguousarray(rows.reshape(a, BLOCK, b, BLOCK, c).transpose(0, 2, 4, 1, 3))
    blocks = rows.view(values.dtype).reshape(a * b * c, BLOCK, BLOCK, BLOCK)
    places = np.flatnonzero(blocks.any(axis=(1, 2, 3)))
    return np.stack(np.unravel_index(places, (a, b, c)), axis=1), blocks[places]


def blocks_of(values: Shaped[np.ndarray, "x y z"]) -> BlockArray:
    """The blocks of a dense array."""
    builder = BlockBuilder(values.shape, values.dtype)
    a = lattice_shape(values.shape)[0]

    def cut(layer: int) -> tuple[np.ndarray, np.ndarray]:
        index, blocks = split(values[BLOCK * layer : BLOCK * (layer + 1)])
        return index + np.asarray([layer, 0, 0]), blocks

    # A few layers side by side, so that no more than these are held twice.
    step = 16
    for start in range(0, a, step):
        for index, blocks in spread(cut, range(start, min(start + step, a))):
            builder.add(index, blocks)
    return builder.finish()
