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
from ..ops.resampling.rescale import _plan_axis
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
    """

    shape: tuple[int, int, int]
    origin: np.ndarray
    voxel_size: float
    first: list[np.ndarray]
    end: list[np.ndarray]
    is_shared: bool


def canvas_for(leaves: LeafMap, voxel_size: float | None = None) -> Canvas:
    """Where the leaves of a map go.

    Args:
        leaves: The map.
        voxel_size: Width of a cell [m]; None for the map's own voxels.
    """
    size = leaves.resolution if voxel_size is None else voxel_size
    base = leaves.low - NUM_KEYS // 2
    lows, firsts, ends, shape = [], [], [], []
    for axis, count in enumerate(leaves.shape):
        low, source, is_coarser = _plan_axis(float(base[axis]), count, leaves.resolution / size)
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
    is_shared = leaves.resolution < size
    return Canvas(tuple(shape), origin_of_cell(np.array(lows), size), size, firsts, ends, is_shared)


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
    low, high = leaves.boxes(level)
    first, size = [], []
    for axis in range(3):
        begin = canvas.first[axis][low[:, axis] - leaves.low[axis]]
        first.append(begin)
        size.append(canvas.end[axis][high[:, axis] - 1 - leaves.low[axis]] - begin)
    state = level.states()
    for chosen in _groups(size):
        shape = tuple(int(along[chosen[0]]) for along in size)
        # All boxes of one size are written at once, without a loop over them or over their cells.
        boxes = sliding_window_view(states, shape, writeable=True)
        odds_boxes = None if log_odds is None else sliding_window_view(log_odds, shape, writeable=True)
        # What is read before it is written is a copy of all boxes, which may be large.
        step = max((1 << 20) // math.prod(shape), 1) if canvas.is_shared else len(chosen)
        for start in range(0, len(chosen), step):
            rows = chosen[start : start + step]
            at = tuple(along[rows] for along in first)
            new, old = state[rows][:, None, None, None], boxes[at] if canvas.is_shared else None
            boxes[at] = new if old is None else np.maximum(old, new)
            if odds_boxes is not None:
                new = level.value[rows][:, None, None, None]
                # The zeros of unknown cells are no log-odds.
                odds_boxes[at] = (
                    new if old is None else np.maximum(np.where(old == UNKNOWN, new, odds_boxes[at]), new)
                )


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
