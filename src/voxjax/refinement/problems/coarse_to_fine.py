"""Coarse to fine: robust scales that fall, and coarser maps for starts beyond the reach of the maps' own fields."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..._checks import check_positive
from ..._runtime.threads import spread
from ..._types import Array
from ...maps.prepared import PreparedMap, prepare_map
from ..solve.equations import move_about

START_DISTANCE = 4.0
"""Robust scale of the first level [voxel]: within the reach of a map's field of nearest voxels, which is 5."""


class CoarseLevel(NamedTuple):
    """Maps to lead starts along.

    Attributes:
        maps: The maps, coarsened.
        scales: Robust scales to lead them with [m].
        num_points: Voxels of each map to use: few, because these levels only lead to the basin.
    """

    maps: list[PreparedMap]
    scales: Float[np.ndarray, "levels"]
    num_points: int = 2048


def checked_distances(
    max_distance: float | None, final_distance: float | None, voxel_size: float
) -> tuple[float, float]:
    """Robust scales at the start and at the end [m]; None takes 4 voxels and 1.

    Raises:
        InputError: If one is not positive.
    """
    first = START_DISTANCE * voxel_size if max_distance is None else max_distance
    last = 1.0 * voxel_size if final_distance is None else final_distance
    first = check_positive("max_distance", first, "m")
    # The scale never grows on the way: a small distance to start with is one to end with, too.
    return first, min(check_positive("final_distance", last, "m"), first)


def robust_scales(first: float, last: float) -> Float[np.ndarray, "levels"]:
    """Robust scale of each level, falling [m]."""
    # Levels while the robust scale halves.
    levels_per_octave = 2
    # What rounding leaves of a whole number of octaves must not add a level.
    num_levels = max(int(np.ceil(levels_per_octave * np.log2(first / last) - 1e-6)), 1)
    # A single level has the last scale: `geomspace` of one number gives where it begins.
    return np.geomspace(last, first, num_levels)[::-1].astype(np.float32)


def scales_in_reach(first: float, last: float, voxel_size: float) -> Float[np.ndarray, "levels"]:
    """Robust scales for maps of a voxel size, the first of them within the reach of their fields [m]."""
    return robust_scales(min(first, START_DISTANCE * voxel_size), last)


def coarse_factors(first: float) -> list[int]:
    """Factors by which maps are coarsened for a robust scale of `first` voxels, coarsest first; none up to 4 voxels."""
    doublings = max(int(np.ceil(np.log2(first / START_DISTANCE) - 1e-6)), 0)
    return [2**k for k in range(doublings, 0, -1)]


def coarse_levels(maps: Sequence[PreparedMap], first: float, voxel_size: float) -> list[CoarseLevel]:
    """Maps coarser by powers of two, coarsest first: to lead starts to within the reach of the maps themselves.

    Args:
        maps: The maps at their own voxel size.
        first: Robust scale at the start [m].
        voxel_size: Voxel size of the maps, or of the coarsest of them [m].
    """
    levels = []
    # Each factor is made of the maps themselves, not of the coarser ones before: rounding would add up.
    for factor in coarse_factors(first / voxel_size):
        grids = [prepared.grid for prepared in maps]
        coarser = spread(
            lambda grid, factor=factor: prepare_map(grid.with_voxel_size(factor * grid.voxel_size)), grids
        )
        # Each level leads from four of its voxels down to two, which are four of the next finer level: there it takes
        # over.
        width = START_DISTANCE * factor * voxel_size
        levels.append(CoarseLevel(coarser, robust_scales(min(width, first), width / 2)))
    return levels


def turned(T_a_b: Float[Array, "4 4"], centroid: Float[Array, "3"]) -> Float[Array, "turns 4 4"]:
    """A pose, and the same turned about the image of the centroid, either way about each axis.

    Far turns end in other valleys more often than far shifts: far starts are led with turned ones.
    """
    # Turns about each axis from which far starts are led as well [degrees].
    side_turn = 20.0
    # The pose as it is comes first, so that it is taken among equals.
    turns = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]) * np.radians(side_turn)
    tangents = np.concatenate([np.zeros_like(turns), turns], axis=1).astype(T_a_b.dtype)
    return jax.vmap(move_about, in_axes=(None, None, 0))(T_a_b, jnp.asarray(centroid), jnp.asarray(tangents))


def better(
    start: Float[Array, "*poses 4 4"],
    before: Float[Array, "*costs"],
    found: Float[Array, "*poses 4 4"],
    after: Float[Array, "*costs"],
) -> tuple[Float[Array, "*poses 4 4"], Float[Array, "*costs"]]:
    """What was found after a start was led, or the start where that was better before, and what it costs.

    Args:
        start: One pose, or several of which each has a cost, or many of a joint problem with one cost.
        before: What it costs.
        found: Poses found.
        after: What they cost.
    """
    is_better: Bool[Array, "*costs"] = jnp.asarray(after < before)
    # One cost may decide about many poses: rank promotion is refused, so axes are added by hand.
    each = is_better.reshape(is_better.shape + (1,) * (start.ndim - is_better.ndim))
    return jnp.where(each, found, start), jnp.where(is_better, after, before)
