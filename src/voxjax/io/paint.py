"""Leaves painted into a dense grid of their own voxels, or of larger or smaller ones, which are never made in between.

The result is that of painting the fine voxels and bringing them to the voxel size with `ops.resampling.rescale`. Time
follows the leaves and the cells that they fill; of the memory of the box, only what leaves fill is touched.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .._types import UNKNOWN
from ..ops.resampling.lattice import origin_of_cell
from ..ops.resampling.rescale import plan_axis
from .leaves import NUM_KEYS, LeafMap, Leaves, pieces


class Canvas(NamedTuple):
    """The grid that leaves are painted into.

    Attributes:
        shape: Number of cells along x, y, z.
        origin: float64 (3,) [m]: outer corner of its lowest cell.
        voxel_size: Width of a cell [m].
        first: For each axis, int32: the first cell that voxel i of the map's window reaches.
        end: For each axis, int32: one past the last.
        is_shared: Whether several leaves may fill one cell.
        is_own: Whether the cells are the voxels of the map's window.
    """

    shape: tuple[int, int, int]
    origin: np.ndarray
    voxel_size: float
    first: list[np.ndarray]
    end: list[np.ndarray]
    is_shared: bool
    is_own: bool


def canvas_for(leaves: LeafMap, voxel_size: float) -> Canvas:
    """Where the leaves of a map go.

    Args:
        leaves: The map.
        voxel_size: Width of a cell [m].
    """
    base = leaves.low - NUM_KEYS // 2
    lows, firsts, ends, shape = [], [], [], []
    for axis, count in enumerate(leaves.shape):
        low, source, is_coarser = plan_axis(float(base[axis]), count, leaves.resolution / voxel_size)
        voxels = np.arange(count)
        # Coarser: `source` has the first voxel of each cell, so that a voxel's cell is the last one begun by then.
        # Finer: it has the voxel of each cell, in ascending order.
        first = (
            np.searchsorted(source, voxels, "right") - 1 if is_coarser else np.searchsorted(source, voxels)
        )
        end = first + 1 if is_coarser else np.searchsorted(source, voxels, "right")
        lows.append(low)
        firsts.append(first.astype(np.int32))
        ends.append(end.astype(np.int32))
        shape.append(len(source))
    return Canvas(
        tuple(shape),
        origin_of_cell(np.array(lows), voxel_size),
        voxel_size,
        firsts,
        ends,
        is_shared=leaves.resolution < voxel_size,
        is_own=leaves.resolution == voxel_size,
    )


def paint(leaves: LeafMap, canvas: Canvas) -> tuple[np.ndarray, np.ndarray | None]:
    """Write the leaves of a map into a grid.

    Args:
        leaves: The map.
        canvas: Where its leaves go.

    Returns:
        States uint8 (x, y, z): occupied where any leaf of a cell is, else free where any is, else unknown; and the
        highest log-odds of the leaves of a cell, float32, 0 where there is none, or None for a map without.
    """
    states = np.zeros(canvas.shape, np.uint8)
    log_odds = np.zeros(canvas.shape, np.float32) if leaves.has_log_odds else None
    for level in leaves.levels:
        for piece in pieces(level):
            # Of leaves that are written together and share a cell the last one stays: that with the largest value.
            ordered = piece.where(np.argsort(piece.value)) if canvas.is_shared else piece
            _fill(states, log_odds, leaves, canvas, ordered)
    return states, log_odds


def _fill(
    states: np.ndarray, log_odds: np.ndarray | None, leaves: LeafMap, canvas: Canvas, level: Leaves
) -> None:
    """Write some leaves of one width.

    Args:
        states: uint8 (x, y, z).
        log_odds: float32 (x, y, z), or None.
        leaves: The map, whose window cuts the leaves.
        canvas: Where voxels go.
        level: The leaves, in the order of their values if they share cells.
    """
    first, size = _cells(leaves, canvas, level)
    state = level.states()
    for chosen in _groups(size):
        shape = tuple(int(along[chosen[0]]) for along in size)
        # What is read before it is written is a copy of all boxes, which may be large.
        step = max((1 << 20) // math.prod(shape), 1) if canvas.is_shared else len(chosen)
        for start in range(0, len(chosen), step):
            rows = chosen[start : start + step]
            at, new, new_odds = tuple(along[rows] for along in first), state[rows], level.value[rows]
            # In boxes of few cells, a loop over these is faster than one over boxes.
            if math.prod(shape) <= 8:
                flat = states.reshape(-1), None if log_odds is None else log_odds.reshape(-1)
                for index in _flat_cells(at, shape, canvas.shape):
                    _write(*flat, index, new, new_odds, is_shared=canvas.is_shared)
            else:
                _write(
                    sliding_window_view(states, shape, writeable=True),
                    None if log_odds is None else sliding_window_view(log_odds, shape, writeable=True),
                    at,
                    new[:, None, None, None],
                    new_odds[:, None, None, None],
                    is_shared=canvas.is_shared,
                )


def _write(
    states: np.ndarray,
    log_odds: np.ndarray | None,
    index: np.ndarray | tuple[np.ndarray, ...],
    new: np.ndarray,
    new_odds: np.ndarray,
    *,
    is_shared: bool,
) -> None:
    """Write values to some cells, or boxes of cells.

    Args:
        states: Cells, or boxes of them.
        log_odds: The same of log-odds, or None.
        index: Which of them.
        new: States for these.
        new_odds: Log-odds for these, if there are any.
        is_shared: Whether the larger value of what is there and what is new is kept.
    """
    if is_shared:
        old = states[index]
        new = np.maximum(old, new)
        if log_odds is not None:
            # The zeros of unknown cells are no log-odds.
            new_odds = np.maximum(np.where(old == UNKNOWN, new_odds, log_odds[index]), new_odds)
    states[index] = new
    if log_odds is not None:
        log_odds[index] = new_odds


def _cells(leaves: LeafMap, canvas: Canvas, level: Leaves) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """First cell of each leaf, and how many it fills: for each axis, (n,) integers."""
    if level.width == 1 and (canvas.is_own or canvas.is_shared):
        # Voxels, which most leaves are, lie in the window and in a single cell.
        first = [level.key[:, axis] - np.int32(leaves.low[axis]) for axis in range(3)]
        if canvas.is_shared:
            first = [cells[places] for cells, places in zip(canvas.first, first, strict=True)]
        return first, [np.broadcast_to(np.int32(1), len(level.key))] * 3
    low, high = leaves.boxes(level)
    first, size = [], []
    for axis in range(3):
        begin, end = low[:, axis] - leaves.low[axis], high[:, axis] - leaves.low[axis]
        if not canvas.is_own:
            begin, end = canvas.first[axis][begin], canvas.end[axis][end - 1]
        first.append(begin)
        size.append(end - begin)
    return first, size


def _flat_cells(
    first: tuple[np.ndarray, ...], shape: tuple[int, ...], dense: tuple[int, ...]
) -> list[np.ndarray]:
    """Flat indices of boxes of one size: for each cell of a box, those of this cell in all boxes.

    Args:
        first: For each axis, (n,): lowest cell of each box.
        shape: Size of the boxes.
        dense: Shape of the array that they lie in.
    """
    strides = np.array([dense[1] * dense[2], dense[2], 1])
    start = np.ravel_multi_index(first, dense)
    return [start + np.dot(offset, strides) for offset in np.ndindex(*shape)]


def _groups(size: list[np.ndarray]) -> list[np.ndarray]:
    """Numbers of boxes of one size, for each size that there is, in the order of the boxes.

    Boxes of one width differ where the window cuts them, and by a cell where the ratio of the voxel sizes is no whole
    number.

    Args:
        size: For each axis, (n,): how many cells each box has along it.
    """
    code = np.ravel_multi_index(size, tuple(int(along.max()) + 1 for along in size))
    if (code == code[0]).all():
        return [np.arange(len(code))]
    order = np.argsort(code, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(code[order])) + 1)
