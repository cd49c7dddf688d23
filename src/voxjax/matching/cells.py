"""Points by the cells of a lattice: sums, means, and the mean of what lies around; cost follows points, not the box."""

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter

from ..ops.blocks.over_tiles import Rows, over_tiles
from ..ops.blocks.windows import TILE


class Cells(NamedTuple):
    """Cells of a lattice that hold a point, in C order.

    Attributes:
        number: int64 (n,): cell of each point, counted from 0.
        index: int64 (k, 3): place of each cell in the lattice.
        count: int64 (k,): how many points it holds.
        shape: Number of cells of the lattice along x, y, z.
    """

    number: np.ndarray
    index: np.ndarray
    count: np.ndarray
    shape: tuple[int, ...]

    @classmethod
    def of(cls, points: np.ndarray, width: float) -> "Cells":
        """Cells so wide around points (n, 3), of which there is one at least."""
        places = np.floor(points / width).astype(np.int64)
        places -= places.min(axis=0)
        shape = tuple((places.max(axis=0) + 1).tolist())
        flat = np.ravel_multi_index(tuple(places.T), shape)
        if math.prod(shape) <= 16 * len(points):
            # Numbers by counting: the lattice has few cells for so many points, and sorting takes longer.
            counts = np.bincount(flat)
            held = np.flatnonzero(counts)
            number, count = (np.cumsum(counts > 0) - 1)[flat], counts[held]
        else:
            held, number, count = np.unique(flat, return_inverse=True, return_counts=True)
        return cls(number, np.stack(np.unravel_index(held, shape), axis=1), count, shape)


def average_by_cell(points: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Cell number of each point and the mean point of each cell, on a lattice of `spacing`; float64."""
    if not len(points):
        return np.zeros(0, np.int64), np.zeros((0, 3))
    cells = Cells.of(points, spacing)
    return cells.number, sum_by_cell(cells.number, points, len(cells.index)) / cells.count[:, None]


def sum_by_cell(cell: np.ndarray, vectors: np.ndarray, count: int) -> np.ndarray:
    """Sum of the vectors of each cell: (count, 3) float64."""
    return np.stack([np.bincount(cell, vectors[:, axis], minlength=count) for axis in range(3)], axis=1)


def toward_surroundings(
    points: np.ndarray, cell_size: float, width: int = 5, *, most: int = TILE // 4
) -> np.ndarray:
    """Vectors from each point to the centroid of the map's points in the `width`³ cells around its own.

    Args:
        points: float64 (n, 3).
        cell_size: Width of a cell, in the unit of the points.
        width: Cells around a point along each axis; odd.
        most: Cells that are looked at in one window, about: numbers of eight bytes, where states are bytes.

    Returns:
        float64 (n, 3).
    """
    if not len(points):
        return np.zeros((0, 3))
    cells = Cells.of(points, cell_size)
    # Of each cell how many points it holds, and the sums of their coordinates.
    sums = np.stack([cells.count, *sum_by_cell(cells.number, points, len(cells.index)).T], axis=1)

    def held(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows = np.flatnonzero(((cells.index >= low) & (cells.index < high)).all(axis=1))
        return high - low, cells.index[rows] - low, sums[rows]

    def mean_around(window: tuple[np.ndarray, ...], low: np.ndarray, rows: Rows) -> np.ndarray:
        shape, places, values = window
        asked, around = tuple((cells.index[rows] - low).T), np.empty((len(cells.index[rows]), 4))
        for column in range(4):
            total = np.zeros(shape)
            total[tuple(places.T)] = values[:, column]
            # The filter divides by the size of its window, which cancels between sums and count; a cell counts itself,
            # so the count is never zero.
            around[:, column] = uniform_filter(total, size=width, mode="constant")[asked]
        return around[:, 1:] / around[:, :1]

    mean = over_tiles(mean_around, held, cells.index, cells.shape, halo=width // 2, most=most)
    return mean[cells.number] - points
