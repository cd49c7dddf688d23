"""The grid that leaves are painted into: their own voxels, or larger or smaller cells, on the lattice of these."""

from typing import NamedTuple

import numpy as np

from ..ops.resampling.axis_plans import plan_axis
from ..ops.resampling.lattice import origin_of_cell
from .leaves import NUM_KEYS, LeafMap, Leaves


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


def cells_of(leaves: LeafMap, canvas: Canvas, level: Leaves) -> tuple[list[np.ndarray], list[np.ndarray]]:
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
