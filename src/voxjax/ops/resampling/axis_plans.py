"""Which voxels go into which cells of another size, along each axis, and the largest of those that share a cell."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int, Shaped, UInt8

from ..._runtime.threads import spread
from ..._types import UNKNOWN


class AxisPlan(NamedTuple):
    """Where the voxels along an axis go.

    Attributes:
        low: Number of the lowest cell, for cells that follow each other.
        index: int64, ascending: for each cell the first of its voxels (coarser) or its only one (finer).
        is_coarser: Whether the cells are coarser.
    """

    low: int
    index: Int[np.ndarray, " cells"]
    is_coarser: bool


def plan_axis(base: float, count: int, ratio: float) -> AxisPlan:
    """Which voxels go into which cells of another size, along one axis.

    Args:
        base: Where the first voxel begins [voxel].
        count: How many voxels there are, at least one.
        ratio: Width of a voxel [cell].
    """
    # Centres that lie on a border of new voxels [voxels] go to the upper one, whichever way they were rounded.
    tie = 1e-4
    if ratio < 1.0:
        cell = np.floor((base + np.arange(count) + 0.5) * ratio + tie).astype(np.int64)
        return AxisPlan(int(cell[0]), np.flatnonzero(np.diff(cell, prepend=cell[0] - 1)), is_coarser=True)
    # A cell more on either side, of which those are kept whose centres lie in the grid.
    low, high = int(np.floor(base * ratio)) - 1, int(np.ceil((base + count) * ratio)) + 1
    cell = np.arange(low, high)
    source = np.floor((cell + 0.5) / ratio - base + tie).astype(np.int64)
    inside = (source >= 0) & (source < count)
    return AxisPlan(int(cell[inside][0]), source[inside], is_coarser=False)


def take_largest(
    values: Shaped[np.ndarray, "x y z"], plans: Sequence[AxisPlan]
) -> Shaped[np.ndarray, "u v w"]:
    """What a grid becomes by the plans of its three axes: the largest voxel of each cell.

    All axes are worked on a few planes at a time: what one axis leaves is in the cache for the next.
    """
    # Planes of the result that one piece of work makes: few, so that all cores have some in small grids.
    planes = 4
    _, index, is_coarser = plans[0]
    result = np.empty([len(index) for _, index, _ in plans], values.dtype)

    def fill(start: int) -> None:
        rows = index[start : start + planes]
        if is_coarser:
            # A new plane takes all old ones up to where the next new one begins.
            end = index[start + planes] if start + planes < len(index) else len(values)
            part = _largest(values[rows[0] : end], 0, rows - rows[0])
        else:
            part = values[rows]
        for axis in (1, 2):
            _, places, is_coarser_there = plans[axis]
            part = _largest(part, axis, places) if is_coarser_there else np.take(part, places, axis=axis)
        result[start : start + planes] = part

    spread(fill, range(0, len(index), planes))
    return result


def known_log_odds(
    states: UInt8[np.ndarray, "x y z"], log_odds: Float32[np.ndarray, "x y z"]
) -> Float32[np.ndarray, "x y z"]:
    """Log-odds with a mark where nothing is known: they must not win over negative ones of free voxels."""
    return np.where(states == UNKNOWN, np.float32(-np.inf), log_odds)


def without_mark(
    states: UInt8[np.ndarray, "x y z"], log_odds: Float32[np.ndarray, "x y z"]
) -> Float32[np.ndarray, "x y z"]:
    """Log-odds with 0 in place of the mark, so that none are infinite."""
    return np.where(states == UNKNOWN, np.float32(0), log_odds)


def _largest(values: np.ndarray, axis: int, first: np.ndarray) -> np.ndarray:
    """Largest of each run of entries along an axis, by where the runs begin.

    States are ordered unknown < free < occupied, so "occupied if any, else free if any" is the maximum.
    """
    last = np.append(first[1:], values.shape[axis]) - 1
    largest = _entries(values, axis, first)
    # Runs of one ratio differ in length by little, so that few entries are looked at twice.
    for step in range(1, int((last - first).max()) + 1):
        # A run that has ended gives its last entry again.
        largest = np.maximum(largest, _entries(values, axis, np.minimum(first + step, last)))
    return largest


def _entries(values: np.ndarray, axis: int, index: np.ndarray) -> np.ndarray:
    # Equal steps, as whole ratios give them, are a slice, which copies nothing.
    steps = np.diff(index)
    if len(steps) and steps[0] > 0 and (steps == steps[0]).all():
        return values[(slice(None),) * axis + (slice(index[0], index[-1] + 1, steps[0]),)]
    return np.take(values, index, axis=axis)
