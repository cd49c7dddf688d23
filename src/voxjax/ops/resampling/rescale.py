"""Change of the resolution of a grid, one axis after the other."""

import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8

from ..._runtime.memory import check_memory
from ..._runtime.threads import spread
from ..._types import UNKNOWN
from .lattice import check_num_voxels, check_places, origin_in_voxels, origin_of_cell


def rescale_states(
    states: UInt8[np.ndarray, "x y z"],
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    new_voxel_size: float,
    log_odds: Float32[np.ndarray, "x y z"] | None = None,
) -> tuple[UInt8[np.ndarray, "u v w"], Float64[np.ndarray, "3"], Float32[np.ndarray, "u v w"] | None]:
    """Bring a grid to another voxel size, on the lattice of multiples of the new one.

    Coarser: each voxel goes where its centre lies; a new voxel is occupied if any of its parts is, else free if any is,
    and has the highest log-odds of its known parts. Finer: a new voxel has the state of the voxel that holds its
    centre. Any ratio is fine.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the grid's voxels [m].
        new_voxel_size: Width of the result's voxels [m].
        log_odds: Or None.

    Returns:
        States, origin and log-odds (None if not given) of the result.

    Raises:
        InputError: If the result would have more than 2**31 - 1 voxels, need more memory than there is,
            or lies so far away that float64 cannot place it.
    """
    if not all(states.shape):
        return states, np.asarray(origin, np.float64), log_odds
    base = origin_in_voxels(origin, voxel_size)
    _check_result(states.shape, base, voxel_size, new_voxel_size, has_log_odds=log_odds is not None)
    # Log-odds of unknown voxels must not win over negative ones of free voxels.
    odds = None if log_odds is None else np.where(states == UNKNOWN, np.float32(-np.inf), log_odds)
    plans = [plan_axis(base[a], states.shape[a], voxel_size / new_voxel_size) for a in range(3)]
    states = _apply(states, plans)
    odds = None if odds is None else _apply(odds, plans)
    if odds is not None:
        # The mark is taken out of voxels that stay unknown, so that no log-odds are infinite.
        odds = np.where(states == UNKNOWN, np.float32(0), odds)
    return states, origin_of_cell(np.array([low for low, _, _ in plans]), new_voxel_size), odds


def _check_result(
    shape: tuple[int, ...], base: np.ndarray, voxel_size: float, new_voxel_size: float, *, has_log_odds: bool
) -> None:
    """Refuse what would be too large before anything is allocated for it.

    Args:
        shape: Number of voxels along x, y, z.
        base: Origin [voxel].
        voxel_size: Width of the grid's voxels [m].
        new_voxel_size: Width of the result's voxels [m].
        has_log_odds: Whether there are log-odds beside the states.
    """
    what, advice = "the map at the new voxel size", "choose a larger voxel size"
    # The result has so many voxels or, along an axis where it begins within one, one more.
    sides = np.maximum(np.floor(np.asarray(shape) * (voxel_size / new_voxel_size)), 1.0)
    check_num_voxels(sides, what, advice)
    check_places(np.stack([base, base + shape]) * voxel_size, new_voxel_size)
    num_voxels = float(np.prod(sides))
    # Log-odds are made with a mark for unknown voxels, which is replaced in a copy.
    need = num_voxels * (10.0 if has_log_odds else 1.0)
    check_memory(need, f"{what}, of {num_voxels:.3g} voxels,", advice, on_device=False)


def plan_axis(base: float, count: int, ratio: float) -> tuple[int, np.ndarray, bool]:
    """Which voxels go into which cells of another size, along one axis.

    Args:
        base: Where the first voxel begins [voxel].
        count: How many voxels there are, at least one.
        ratio: Width of a voxel [cell].

    Returns:
        Number of the lowest cell, for cells that follow each other; for each cell the first of its voxels (coarser) or
        its only one (finer), int64 in ascending order; and whether the cells are coarser.
    """
    # Centres that lie on a border of new voxels [voxels] go to the upper one, whichever way they were rounded.
    tie = 1e-4
    if ratio < 1.0:
        cell = np.floor((base + np.arange(count) + 0.5) * ratio + tie).astype(np.int64)
        return int(cell[0]), np.flatnonzero(np.diff(cell, prepend=cell[0] - 1)), True
    # A cell more on either side, of which those are kept whose centres lie in the grid.
    low, high = int(np.floor(base * ratio)) - 1, int(np.ceil((base + count) * ratio)) + 1
    cell = np.arange(low, high)
    source = np.floor((cell + 0.5) / ratio - base + tie).astype(np.int64)
    inside = (source >= 0) & (source < count)
    return int(cell[inside][0]), source[inside], False


def _apply(values: np.ndarray, plans: list[tuple[int, np.ndarray, bool]]) -> np.ndarray:
    """All three axes, a few planes at a time: what one axis leaves is in the cache for the next."""
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
