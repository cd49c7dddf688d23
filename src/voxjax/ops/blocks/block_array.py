"""`BlockArray`: an array over a box of voxels, kept as blocks of 8 x 8 x 8; memory follows what differs, not the box.

A table says for each block of the box which row of a pool it is. Blocks that hold one value alone share a row, so that
free space and the unknown cost a table entry each, whatever volume they fill. A table is memory of the operating
system's that was never written where all is 0, so that it costs nothing there.
"""

from collections.abc import Iterator
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int, Int32, Shaped

from ..._runtime.memory import check_memory
from ..._runtime.threads import spread
from ..._types import Array
from .words import BLOCK

BLOCK_VOXELS = BLOCK**3
Shape = tuple[int, int, int]
Corner = tuple[int, ...] | Int[np.ndarray, "3"]


class BlockArray(eqx.Module):
    """Values of the voxels of a box.

    Attributes:
        table: int32 (a, b, c): row of each block in the pool; block (i, j, k) begins at voxel (8 i, 8 j, 8 k).
        pool: (n, 8, 8, 8) of any dtype: the blocks. Row 0 is all zeros, no other row that holds one value is like
            another one, and what lies beyond the box is 0.
        shape: Number of voxels along x, y, z.
    """

    table: Int32[Array, "a b c"]
    pool: Shaped[Array, "n 8 8 8"]
    shape: Shape = eqx.field(static=True)

    @property
    def dtype(self) -> np.dtype:
        """Kind of number that a voxel holds."""
        return self.pool.dtype

    @property
    def num_voxels(self) -> int:
        """Number of voxels of the box."""
        x, y, z = self.shape
        return x * y * z

    @property
    def num_bytes(self) -> int:
        """Memory of the pool and of a table that is written everywhere [byte]."""
        return self.pool.size * self.dtype.itemsize + 4 * self.table.size

    @cached_property
    def is_uniform(self) -> Bool[np.ndarray, "n"]:
        """Whether all voxels of each row of the pool hold one value."""
        return is_uniform(np.asarray(self.pool))

    @cached_property
    def uses(self) -> Int[np.ndarray, "n"]:
        """How many blocks of the box each row of the pool stands for."""
        flat, counts = np.asarray(self.table).reshape(-1), np.zeros(len(self.pool), np.int64)
        # A part of the table at a time: it is brought to int64 for this. Most of a large one is 0.
        step = max(1 << 20, len(counts))
        for start in range(0, len(flat), step):
            part = flat[start : start + step]
            part = part[part != 0]
            if len(part):
                counts += np.bincount(part, minlength=len(counts))
        counts[0] = len(flat) - counts.sum()
        return counts

    def places(self, is_wanted: Bool[np.ndarray, "n"] | None = None) -> Int32[np.ndarray, "m 3"]:
        """Places of blocks in the table, in lexicographic order; made at each call.

        Args:
            is_wanted: Rows of the pool whose blocks are listed; None for those that are not all 0.
        """
        table = np.asarray(self.table)
        flat, step = table.reshape(-1), 1 << 22
        parts = ((start, flat[start : start + step]) for start in range(0, len(flat), step))
        found = [
            np.flatnonzero(rows if is_wanted is None else is_wanted[rows]) + start for start, rows in parts
        ]
        numbers = np.concatenate([np.zeros(0, np.int64), *(part for part in found if len(part))])
        index = np.empty((len(numbers), 3), np.int32)
        for axis, along in enumerate(np.unravel_index(numbers, table.shape) if len(numbers) else ()):
            index[:, axis] = along
        return index

    def __array__(self, dtype: np.typing.DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        """The dense array, as NumPy asks for it."""
        return np.asarray(self.dense(), dtype)

    def dense(self) -> Array:
        """All voxels of the box, (x, y, z); on the device, if the pool lies there or is traced.

        Raises:
            InputError: If there is not enough memory for the box.
        """
        if isinstance(self.pool, jax.Array) or isinstance(self.table, jax.Array):
            blocks = jnp.asarray(self.pool)[jnp.asarray(self.table)]
            a, b, c = self.table.shape
            whole = blocks.transpose(0, 3, 1, 4, 2, 5).reshape(BLOCK * a, BLOCK * b, BLOCK * c)
            return whole[tuple(slice(0, n) for n in self.shape)]
        size = float(self.num_voxels) * self.dtype.itemsize
        if size > 1 << 24:  # a smaller one is not worth the milliseconds of asking
            box = " x ".join(map(str, self.shape))
            advice = "crop the map, or take a larger voxel size"
            check_memory(size, f"the dense array of {box} voxels", advice, on_device=False)
        return self.window((0, 0, 0), self.shape)

    def view(self) -> Array:
        """`dense`, but read-only: what somebody writes there would not reach the blocks. A small one is made once.

        Raises:
            InputError: As from `dense`.
        """
        is_small = self.num_voxels * self.dtype.itemsize <= 1 << 24
        return self._small_view if is_small else read_only(self.dense())

    @cached_property
    def _small_view(self) -> Array:
        return read_only(self.dense())

    def window(self, low: Corner, high: Corner) -> np.ndarray:
        """Voxels from `low` up to and without `high`, dense; 0 beyond the box.

        Args:
            low: Lowest voxel, which may lie outside.
            high: One past the highest.
        """
        first = [int(n) for n in low]
        size = tuple(max(int(h) - l, 0) for l, h in zip(first, high, strict=True))
        begin = [max(l, 0) for l in first]
        end = [min(h, n) for h, n in zip(high, self.shape, strict=True)]
        inside = all(b < e for b, e in zip(begin, end, strict=True))
        is_whole = inside and all(b == l and e == h for b, e, l, h in zip(begin, end, low, high, strict=True))
        found = np.empty(size, self.dtype) if is_whole else np.zeros(size, self.dtype)
        if not inside:
            return found
        target = found[tuple(slice(b - l, e - l) for b, e, l in zip(begin, end, low, strict=True))]
        blocks = tuple(slice(b // BLOCK, -(-e // BLOCK)) for b, e in zip(begin, end, strict=True))
        table = np.asarray(self.table)[blocks]
        # Rows of a block move as one value each, in a third of the time.
        rows_of = np.asarray(self.pool).view(f"V{BLOCK * self.dtype.itemsize}")[..., 0]
        first = [b - BLOCK * cut.start for b, cut in zip(begin, blocks, strict=True)]

        if found.size <= 1 << 20:  # hands over to other threads would take longer than the copy
            a, b, c = table.shape
            rows = np.ascontiguousarray(rows_of[table].transpose(0, 3, 1, 4, 2))
            cut = tuple(slice(f, f + n) for f, n in zip(first, target.shape, strict=True))
            target[...] = rows.view(self.dtype).reshape(BLOCK * a, BLOCK * b, BLOCK * c)[cut]
            return found

        def fill(layer: int) -> None:
            # Of a layer of blocks along x, those planes that the window has.
            start, stop = BLOCK * layer - first[0], BLOCK * (layer + 1) - first[0]
            planes = slice(max(start, 0), min(stop, len(target)))
            cut = slice(planes.start - start, planes.stop - start)
            part = np.ascontiguousarray(rows_of[:, cut][table[layer]].transpose(2, 0, 3, 1)).view(self.dtype)
            rows = part.reshape(part.shape[0], BLOCK * part.shape[1], part.shape[3])
            target[planes] = rows[
                :, first[1] : first[1] + target.shape[1], first[2] : first[2] + target.shape[2]
            ]

        spread(fill, range(len(table)))
        return found

    def take(self, index: Int[np.ndarray, "m 3"]) -> Shaped[np.ndarray, " m"]:
        """Values at voxels inside the box."""
        block, cell = index >> 3, index & 7
        row = np.asarray(self.table)[tuple(block.T)]
        return np.asarray(self.pool)[row, cell[:, 0], cell[:, 1], cell[:, 2]]

    def count(self, value: object) -> int:
        """How many voxels of the box hold a value that is not 0."""
        return int(self._count_in_rows(value) @ self.uses)

    def _count_in_rows(self, value: object) -> Int[np.ndarray, "n"]:
        """How many voxels of each row of the pool hold a value."""
        pool, step = np.asarray(self.pool).reshape(len(self.pool), -1), 1 << 13

        def count_rows(start: int) -> np.ndarray:
            # Truth values are added eight at a time, 64 to a byte at most.
            words = (pool[start : start + step] == value).view(np.uint64).sum(axis=1, dtype=np.uint64)
            return words.view(np.uint8).reshape(-1, 8).sum(axis=1, dtype=np.int64)

        return np.concatenate(spread(count_rows, range(0, len(pool), step)))

    def where(self, value: object) -> Int32[np.ndarray, "m 3"]:
        """Voxels that hold a value that is not 0, int32 (m, 3), in lexicographic order.

        Raises:
            InputError: If there is not enough memory for the list.
        """
        in_rows = self._count_in_rows(value)
        count = int(in_rows @ self.uses)
        if count > 1 << 22:  # a short list is not worth the milliseconds of asking
            advice = "crop the map, or take a larger voxel size"
            check_memory(36.0 * count, f"the list of {count:,} voxels", advice, on_device=False)
        blocks = self.places(in_rows != 0)
        # Layer by layer along x, in which a sort puts the voxels of the blocks in their order.
        ends = np.searchsorted(blocks[:, 0], np.arange(self.table.shape[0] + 1))

        def list_layer(layer: int) -> np.ndarray:
            chosen = blocks[ends[layer] : ends[layer + 1]]
            row, *cell = np.nonzero(np.asarray(self.pool)[np.asarray(self.table)[tuple(chosen.T)]] == value)
            x, y, z = (BLOCK * chosen[row, axis] + cell[axis].astype(np.int32) for axis in range(3))
            key = (cell[0] * self.shape[1] + y) * np.int64(self.shape[2]) + z
            order = np.argsort(key)
            return np.stack([x[order], y[order], z[order]], axis=1)

        found = spread(list_layer, np.flatnonzero(np.diff(ends)).tolist())
        return np.concatenate(found) if found else np.zeros((0, 3), np.int32)

    def known_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest voxel that is not 0, and one past the highest, int64 (3,) each; both 0 where all are."""
        blocks = self.places()
        if not len(blocks):
            return np.zeros(3, np.int64), np.zeros(3, np.int64)
        rows = np.asarray(self.table)[tuple(blocks.T)]
        low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)

        def layers(chosen: np.ndarray, axis: int) -> np.ndarray:
            cells = np.asarray(self.pool)[np.unique(rows[chosen])] != 0
            return np.flatnonzero(cells.any(axis=tuple(other for other in range(4) if other != axis + 1)))

        for axis, place in enumerate(blocks.T):
            # Each of these blocks holds something, so that the outermost ones alone tell where it begins and ends.
            first, last = int(place.min()), int(place.max())
            low[axis] = BLOCK * first + layers(place == first, axis)[0]
            high[axis] = BLOCK * last + layers(place == last, axis)[-1] + 1
        return low, high

    def equals(self, other: "BlockArray") -> bool:
        """Whether both hold the same values, whichever rows of their pools stand for them."""
        if self.shape != other.shape:
            return False
        # Pairs of rows that stand for one block somewhere: far fewer than blocks.
        mine, theirs = (np.asarray(each.table).reshape(-1) for each in (self, other))
        found, step = [np.zeros(0, np.int64)], 1 << 20
        for start in range(0, len(mine), step):
            a, b = mine[start : start + step], theirs[start : start + step]
            # Row 0 is the same in both.
            some = np.flatnonzero((a != 0) | (b != 0))
            found.append(np.unique(a[some] * np.int64(len(other.pool)) + b[some]))
        pairs, step = np.unique(np.concatenate(found)), 1 << 12
        return all(
            np.array_equal(self.pool[part // len(other.pool)], other.pool[part % len(other.pool)])
            for part in (pairs[start : start + step] for start in range(0, len(pairs), step))
        )

    def parts(self) -> Iterator[tuple[Int[np.ndarray, "m 3"], Shaped[np.ndarray, "m 8 8 8"]]]:
        """Blocks that are not all 0, some thousand at a time: their places in the table, and their values."""
        blocks = self.places()
        step = 1 << 12
        for start in range(0, len(blocks), step):
            index = blocks[start : start + step]
            yield index, np.asarray(self.pool)[np.asarray(self.table)[tuple(index.T)]]


def is_uniform(blocks: Shaped[np.ndarray, "n 8 8 8"]) -> Bool[np.ndarray, "n"]:
    """Whether all voxels of each block hold one value."""
    flat = blocks.reshape(len(blocks), -1)
    # Bytes are compared eight at a time.
    words = flat.view(np.uint64) if flat.dtype.itemsize < 8 and flat.flags.c_contiguous else flat
    is_level = (words == words[:, :1]).all(axis=1)
    return is_level & (flat[:, : 8 // flat.dtype.itemsize] == flat[:, :1]).all(axis=1)


def read_only(values: Array) -> Array:
    """An array that nobody else holds, as one that cannot be written; those of JAX never can."""
    if isinstance(values, np.ndarray):
        values.flags.writeable = False
    return values


def lattice_shape(shape: tuple[int, ...]) -> Shape:
    """Number of blocks along x, y, z of a box of voxels."""
    x, y, z = (-(-n // BLOCK) for n in shape)
    return x, y, z
