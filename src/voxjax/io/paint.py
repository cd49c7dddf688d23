"""Leaves painted into blocks of their own voxels, or of larger or smaller ones, which are never made in between.

The result is that of painting the fine voxels into a dense array of the box and bringing it to the voxel size with
`ops.resampling.rescale`. Time and memory follow the leaves and the blocks that they fill in part; what a wide leaf
fills as a whole is entries of a table that share one block.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .._types import FREE, OCCUPIED, UNKNOWN
from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray, lattice_shape
from ..ops.blocks.block_builder import BlockBuilder
from ..ops.blocks.words import BLOCK
from .canvas import Canvas
from .leaf_parts import CutLeaves, Parts

BLOCKS_AT_ONCE = 1 << 15
"""Blocks that are painted before the next ones are begun: less than a hundred megabytes."""


class _Painting(NamedTuple):
    """Blocks that are being painted.

    Attributes:
        states: uint8 (n, 8, 8, 8).
        log_odds: float32 (n, 8, 8, 8), or None.
    """

    states: np.ndarray
    log_odds: np.ndarray | None


def paint(cut: CutLeaves, canvas: Canvas) -> tuple[BlockArray, BlockArray | None]:
    """Write the leaves of a map into a grid.

    Args:
        cut: The leaves, cut at the borders of the grid's blocks.
        canvas: The grid.

    Returns:
        States uint8 (x, y, z): occupied where any leaf of a cell is, else free where any is, else unknown; and the
        highest log-odds of the leaves of a cell, float32, 0 where there is none, or None for a map without.
    """
    has_log_odds = cut.parts.value.dtype != np.uint8
    kinds = (np.uint8, np.float32) if has_log_odds else (np.uint8,)
    # Blocks with parts differ at most, beside one for each value that fills whole blocks.
    most = [len(cut.block) + 2, len(cut.block) + len(cut.boxes.value)]
    builders = [
        BlockBuilder(canvas.shape, kind, capacity=count) for kind, count in zip(kinds, most, strict=False)
    ]
    _fill_boxes(cut, builders)
    index = np.stack(np.unravel_index(cut.block, lattice_shape(canvas.shape)), axis=1)
    # Cells that several leaves share may also belong to a block that one of them fills.
    begun = [builder.levels_at(index) for builder in builders] if len(cut.boxes.value) else None
    for start, parts in _groups_of_rows(cut.parts, len(index), BLOCKS_AT_ONCE):
        rows = slice(start, min(start + BLOCKS_AT_ONCE, len(index)))
        painting = [np.zeros((rows.stop - rows.start, BLOCK, BLOCK, BLOCK), kind) for kind in kinds]
        if begun is not None:
            for blocks, levels in zip(painting, begun, strict=True):
                blocks[:] = levels[rows, None, None, None]
        _paint_parts(_Painting(painting[0], painting[1] if has_log_odds else None), parts, canvas)
        for builder, blocks in zip(builders, painting, strict=True):
            builder.add(index[rows], blocks)
    finished = [builder.finish() for builder in builders]
    return finished[0], finished[1] if has_log_odds else None


def _fill_boxes(cut: CutLeaves, builders: list[BlockBuilder]) -> None:
    """Write what fills whole blocks; boxes of one size together."""
    low, size, value = cut.boxes
    if not len(value):
        return
    code = np.ravel_multi_index(tuple(size.T), tuple((size.max(axis=0) + 1).tolist()))
    for chosen in _groups(np.asarray(code)):
        values = [_states_of(value[chosen]), value[chosen]]
        for builder, some in zip(builders, values, strict=False):
            builder.put_boxes(low[chosen], tuple(size[chosen[0]].tolist()), some)


def _groups_of_rows(parts: Parts, num_rows: int, step: int) -> list[tuple[int, Parts]]:
    """Parts by their blocks, `step` of these at a time: the first block, and the parts, counted from it on."""
    if num_rows <= step:
        return [(0, parts)]
    order = np.argsort(parts.cell)
    starts = range(0, num_rows, step)
    ends = np.searchsorted(parts.cell, BLOCK_VOXELS * np.array([*starts, num_rows]), sorter=order)
    groups = []
    for start, begin, end in zip(starts, ends, ends[1:], strict=False):
        part = parts.where(order[begin:end])
        groups.append((start, part._replace(cell=part.cell - BLOCK_VOXELS * start)))
    return groups


def _paint_parts(painting: _Painting, parts: Parts, canvas: Canvas) -> None:
    """Write parts of leaves into blocks; those of one size together."""
    # Most parts are single cells; to sort the others is enough.
    is_one = parts.size == 0
    rest = np.flatnonzero(~is_one)
    for chosen in (np.flatnonzero(is_one), *(rest[group] for group in _groups(parts.size[rest]))):
        if not len(chosen):
            continue
        size = int(parts.size[chosen[0]])
        shape = ((size >> 6) + 1, (size >> 3 & 7) + 1, (size & 7) + 1)
        some = parts.where(chosen)
        # What is read before it is written is a copy of all boxes, which may be large.
        step = 1 << 14 if canvas.is_shared else len(chosen)
        for start in range(0, len(chosen), step):
            piece = some.where(slice(start, start + step))
            # Of parts that are written together and share a cell the last one stays: that with the largest value.
            piece = piece.where(np.argsort(piece.value)) if canvas.is_shared else piece
            _paint_group(painting, piece, shape, is_shared=canvas.is_shared)


def _paint_group(painting: _Painting, parts: Parts, shape: tuple[int, int, int], *, is_shared: bool) -> None:
    """Write parts of one size."""
    states, odds, log_odds = _states_of(parts.value), parts.value, painting.log_odds
    # In boxes of few cells, a loop over these is faster than one over boxes.
    if shape[0] * shape[1] * shape[2] <= BLOCK:
        flat = _Painting(painting.states.reshape(-1), None if log_odds is None else log_odds.reshape(-1))
        for x, y, z in np.ndindex(*shape):
            _write(flat, parts.cell + (x << 6 | y << 3 | z), states, odds, is_shared=is_shared)
        return

    def windows(blocks: np.ndarray) -> np.ndarray:
        return sliding_window_view(blocks, shape, axis=(1, 2, 3), writeable=True)

    views = _Painting(windows(painting.states), None if log_odds is None else windows(log_odds))
    place = np.unravel_index(parts.cell, painting.states.shape)
    _write(views, place, states[:, None, None, None], odds[:, None, None, None], is_shared=is_shared)


def _write(
    painting: _Painting,
    index: np.ndarray | tuple[np.ndarray, ...],
    new: np.ndarray,
    new_odds: np.ndarray,
    *,
    is_shared: bool,
) -> None:
    """Write values to some cells, or boxes of cells.

    Args:
        painting: Cells, or boxes of them.
        index: Which of them.
        new: States for these.
        new_odds: Log-odds for these, if there are any.
        is_shared: Whether the larger value of what is there and what is new is kept.
    """
    states, log_odds = painting
    if is_shared:
        old = states[index]
        new = np.maximum(old, new)
        if log_odds is not None:
            # The zeros of unknown cells are no log-odds.
            new_odds = np.maximum(np.where(old == UNKNOWN, new_odds, log_odds[index]), new_odds)
    states[index] = new
    if log_odds is not None:
        log_odds[index] = new_odds


def _states_of(value: np.ndarray) -> np.ndarray:
    """States of leaves, as `Leaves.states` has them."""
    return value if value.dtype == np.uint8 else np.where(value >= 0, OCCUPIED, FREE)


def _groups(code: np.ndarray) -> list[np.ndarray]:
    """Places of equal numbers, for each number that there is, in ascending order."""
    order = np.argsort(code, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(code[order])) + 1)
