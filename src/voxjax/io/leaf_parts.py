"""Leaves cut at the borders of blocks: boxes of whole blocks, and parts that lie in one block each.

A wide leaf is one box of whole blocks and the parts around it; most leaves are one voxel and one part. Cost follows the
leaves and their surfaces, whatever box the map spans.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .._runtime.tables import reserve
from ..ops.blocks.block_array import lattice_shape
from ..ops.blocks.words import BLOCK
from .canvas import Canvas, cells_of
from .leaves import LeafMap, Leaves, pieces

FEW_BLOCKS = 1 << 13
"""So many blocks are painted, whether or not leaves fill them in part: to number these would take longer."""


class Parts(NamedTuple):
    """Parts of leaves that lie in one block each.

    Attributes:
        cell: int64 (n,): lowest cell of the part, counted through blocks of 512 cells, in their order and in C order.
        size: int16 (n,): cells along x, y, z, less one each, as the number of a cell in its block.
        value: (n,): what the leaf holds.
    """

    cell: np.ndarray
    size: np.ndarray
    value: np.ndarray

    def where(self, chosen: np.ndarray | slice) -> "Parts":
        """The parts that a list of numbers or a slice chooses."""
        return Parts(self.cell[chosen], self.size[chosen], self.value[chosen])


class Boxes(NamedTuple):
    """Boxes of whole blocks that one leaf fills.

    Attributes:
        low: int32 (n, 3): lowest block.
        size: int32 (n, 3): number of blocks along x, y, z.
        value: (n,): what the leaf holds.
    """

    low: np.ndarray
    size: np.ndarray
    value: np.ndarray


class CutLeaves(NamedTuple):
    """The leaves of a map, cut at the borders of a canvas' blocks.

    Attributes:
        boxes: What fills whole blocks.
        parts: What is left.
        block: int64 (m,): blocks in the order in which `parts` counts them, by their numbers in the lattice in C order:
            those that have parts, or all of a small lattice.
    """

    boxes: Boxes
    parts: Parts
    block: np.ndarray


def cut_leaves(leaves: LeafMap, canvas: Canvas, *, has_table: bool = True) -> CutLeaves:
    """Cut the leaves of a map at the borders of blocks.

    Args:
        leaves: The map, which is not empty.
        canvas: The grid that is in blocks.
        has_table: Whether blocks are told apart by a table of the whole lattice, which is faster than to sort them.
    """
    lattice = lattice_shape(canvas.shape)
    rows, parts, boxes = _Rows(lattice) if has_table else _Numbers(lattice), [], []
    for level in leaves.levels:
        for piece in pieces(level):
            inner, rest = _cut(leaves, canvas, piece, rows)
            parts.append(rest)
            if len(inner.value):
                boxes.append(inner)
    kind, all_parts = leaves.levels[0].value.dtype, Parts(*map(np.concatenate, zip(*parts, strict=True)))
    nothing = Boxes(np.zeros((0, 3), np.int32), np.zeros((0, 3), np.int32), np.zeros(0, kind))
    return CutLeaves(
        Boxes(*map(np.concatenate, zip(nothing, *boxes, strict=True))),
        *rows.in_order(all_parts),
    )


class _Rows:
    """Blocks in some order, in which they are painted; cost follows those that are seen."""

    def __init__(self, lattice: tuple[int, int, int]) -> None:
        self._lattice = lattice
        num_blocks = lattice[0] * lattice[1] * lattice[2]
        # Of few blocks all are taken, in the order of the lattice; of many those alone that leaves fill in part.
        is_small = num_blocks <= FEW_BLOCKS
        self._row = None if is_small else reserve(num_blocks, dtype=np.int32)
        self._seen = [np.arange(num_blocks if is_small else 0)]
        self._count = 0

    def of(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Numbers int32 of blocks, given by their places in the lattice."""
        _, ny, nz = self._lattice
        # A lattice has fewer blocks than int32 counts.
        block = (x * np.int32(ny) + y) * np.int32(nz) + z
        if self._row is None:
            return block
        row = self._row[block]
        is_new = row == 0
        if is_new.any():
            new = np.unique(block[is_new])
            self._row[new] = np.arange(self._count + 1, self._count + 1 + len(new), dtype=np.int32)
            self._seen.append(new)
            self._count += len(new)
            row = self._row[block]
        # Rows of blocks that were not seen are 0.
        row -= 1
        return row

    def in_order(self, parts: Parts) -> tuple[Parts, np.ndarray]:
        """The parts, and the blocks that were seen, int64 (m,), by their numbers in the lattice."""
        return parts, np.concatenate(self._seen)


class _Numbers:
    """Blocks by their numbers in the lattice, which may have any number of them: sorted at the end, without a table."""

    def __init__(self, lattice: tuple[int, int, int]) -> None:
        self._lattice = lattice

    def of(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Numbers int64 of blocks, given by their places in the lattice."""
        _, ny, nz = self._lattice
        return (x.astype(np.int64) * ny + y) * nz + z

    def in_order(self, parts: Parts) -> tuple[Parts, np.ndarray]:
        """The parts, which count the blocks that have some, and the numbers of these, int64 (m,)."""
        block, row = np.unique(parts.cell >> 9, return_inverse=True)
        return parts._replace(cell=row.reshape(-1) << 9 | parts.cell & 511), block


def _cut(leaves: LeafMap, canvas: Canvas, level: Leaves, rows: "_Rows | _Numbers") -> tuple[Boxes, Parts]:
    """Cut some leaves of one width."""
    first, size = cells_of(leaves, canvas, level)
    first = [along.astype(np.int32, copy=False) for along in first]
    if all(along.strides == (0,) and along[0] == 1 for along in size):
        none = Boxes(np.zeros((0, 3), np.int32), np.zeros((0, 3), np.int32), level.value[:0])
        return none, Parts(_cells(rows, first), np.zeros(len(level.key), np.int16), level.value)
    low, extent = np.stack(first), np.stack(size).astype(np.int32, copy=False)
    # Most leaves lie in one block as they are.
    last = low + extent - 1
    is_within = ((low ^ last) < BLOCK).all(axis=0) & (extent < BLOCK).any(axis=0)
    inside = np.flatnonzero(is_within)
    parts = [(low[:, inside], extent[:, inside], inside)]
    across = np.flatnonzero(~is_within)
    ends, leaf = _split(np.stack([low[:, across].T, last[:, across].T + 1], axis=1), across)
    is_whole = ((ends & 7) == 0).all(axis=(1, 2))
    begin, end = ends[is_whole, 0] >> 3, ends[is_whole, 1] >> 3
    boxes = Boxes(begin, end - begin, level.value[leaf[is_whole]])
    ends, leaf = _one_block_each(ends[~is_whole], leaf[~is_whole])
    parts.append((ends[:, 0].T, (ends[:, 1] - ends[:, 0]).T, leaf))
    low, extent, leaf = (np.concatenate(columns, axis=-1) for columns in zip(*parts, strict=True))
    size = _cell_number(*(extent - 1)).astype(np.int16)
    return boxes, Parts(_cells(rows, low), size, level.value[leaf])


def _cells(rows: "_Rows | _Numbers", low: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Cells int64 (n,) as `Parts` has them, from places along x, y, z."""
    row = rows.of(*(along >> 3 for along in low)).astype(np.int64)
    return row << 9 | _cell_number(*(along & 7 for along in low))


def _cell_number(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Numbers of cells of a block, in C order."""
    return x << 6 | y << 3 | z


def _split(ends: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut boxes where they enter and leave whole blocks, along one axis after the other.

    Args:
        ends: int32 (n, 2, 3): lowest cell and one past the highest.
        which: int64 (n,): of which leaf each is.

    Returns:
        The same for (m,) boxes, each of whole blocks or within one block along every axis.
    """
    for axis in range(3):
        low, high = ends[:, 0, axis], ends[:, 1, axis]
        enters = np.minimum((low + 7) & ~7, high)
        cuts = low, enters, np.maximum(high & ~7, enters), high
        pieces_along = []
        for begin, end in pairwise(cuts):
            chosen = np.flatnonzero(begin < end)
            piece = ends[chosen]
            piece[:, 0, axis], piece[:, 1, axis] = begin[chosen], end[chosen]
            pieces_along.append((piece, which[chosen]))
        ends, which = map(np.concatenate, zip(*pieces_along, strict=True))
    return ends, which


def _one_block_each(ends: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut boxes that are several whole blocks long along some axes.

    Args:
        ends: int32 (n, 2, 3), as `_split` gives it.
        which: int64 (n,): of which leaf each is.

    Returns:
        The same for boxes within one block each.
    """
    counts = ((ends[:, 1] - 1) >> 3) - (ends[:, 0] >> 3) + 1
    total = counts.prod(axis=1, dtype=np.int64)
    if (total == 1).all():
        return ends, which
    box = np.repeat(np.arange(len(ends)), total)
    number = np.arange(len(box)) - np.repeat(np.cumsum(total) - total, total)
    ends, counts = ends[box], counts[box]
    for axis in (2, 1, 0):
        number, step = np.divmod(number, counts[:, axis])
        ends[:, 0, axis] += BLOCK * step
        ends[:, 1, axis] = np.minimum(ends[:, 1, axis], (ends[:, 0, axis] & ~7) + BLOCK)
    return ends, which[box]
