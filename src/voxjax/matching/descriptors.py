"""Surface points of a map with local descriptors, computed once a map, and their matches with another map.

The occupied voxels are averaged on a working lattice two to three voxels wide, described at two scales, and
matched scale by scale. Maps of any size run the same kernels.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from .._checks import InputError, check_positive
from .._runtime.threads import spread
from .._types import FREE, Array
from ..grid import VoxelGrid
from ..maps.settings import MapConfig
from ..ops.blocks.over_tiles import Rows, over_tiles
from ..ops.descriptors.fpfh import point_feature_histograms, surface_normals
from ..ops.descriptors.match import mutual_nearest
from ..ops.descriptors.tiles import near_tiles, point_tree
from .cells import average_by_cell, sum_by_cell, toward_surroundings

NORMAL_RADIUS = 3.001
DESCRIPTOR_RADIUS = 5.001
"""Radii of the normal and of the descriptor, in working spacings; not whole, as many points lie just so far apart, and
rounding would decide."""


class DescriptorLevel(eqx.Module):
    """Described surface points of one map at one scale.

    Attributes:
        points: float32 (n, 3) [m], relative to the map's `center`.
        normals: float32 (n, 3), unit, signed as `MapDescriptors.side` says.
        descriptors: float32 (n, d); Euclidean distances compare them.
        spacing: Working spacing of this level [m].
    """

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    descriptors: Float[Array, "n d"]
    spacing: float


class MapDescriptors(eqx.Module):
    """All that matching needs to know of a map.

    Attributes:
        levels: One entry a scale, fine to coarse.
        center: float64 (3,) [m] in the map's frame; points are relative to it.
        side: What signs the normals: "free" (toward free space) or "surroundings" (toward the mass of the map
            within a few metres, for maps without free space). Only equal sides can be matched.
    """

    levels: tuple[DescriptorLevel, ...]
    center: Float[Array, "3"]
    side: str = eqx.field(static=True)


def working_spacing(*voxel_sizes: float, most: float = MapConfig.descriptor_spacing) -> float:
    """Spacing [m] at which maps of these voxel sizes can be compared: that of the coarsest.

    A map whose voxels are coarser than the largest spacing is taken as it is.

    Args:
        *voxel_sizes: Edge lengths of the maps' voxels [m].
        most: Largest spacing [m]: furniture has no shape beyond it.
    """
    # Working spacing over the map's voxel size; averages the steps of the lattice away.
    spacing_in_voxels = 2.5
    coarsest = max(check_positive("voxel_size", size, "m") for size in voxel_sizes)
    return max(min(most, spacing_in_voxels * coarsest), coarsest)


def finest_level(grid: VoxelGrid, *, spacing: float, max_points: int = MapConfig.max_described) -> int:
    """The finest level at which a map has few enough points to be matched: 0 is that of the working spacing.

    Args:
        grid: The map.
        spacing: Working spacing [m].
        max_points: Largest number of points: the time of matching grows with the square.
    """
    points = grid.occupied_points()
    level = 0
    if not len(points):
        return level
    # Cells as `describe_map` lays them.
    points = points - points.mean(axis=0)
    while len(average_by_cell(points, _scale(level) * spacing)[1]) > max_points:
        level += 1
    return level


def describe_map(
    grid: VoxelGrid,
    *,
    spacing: float | None = None,
    use_free_space: bool | None = None,
    finest: int | None = None,
) -> MapDescriptors:
    """Describe the surface of a map at two scales; at one, where the finer has too many points.

    Args:
        grid: The map.
        spacing: Working spacing [m]; the same for all maps that will be matched (`working_spacing`). None: by
            the voxel size of this map.
        use_free_space: Sign the normals toward free space. None: if the map has free voxels. Maps that will
            be matched need the same choice, so give False when one of them has no free space.
        finest: Level at which to begin, the same for all maps that will be matched: the greatest `finest_level` of
            theirs. None: that of this map.

    Returns:
        Descriptors; without any point where the map has no occupied voxel.

    Raises:
        InputError: If free space is asked for and the map has none, or the spacing is not positive.
    """
    spacing = working_spacing(grid.voxel_size) if spacing is None else check_positive("spacing", spacing, "m")
    has_free = grid.num_free > 0
    if use_free_space and not has_free:
        raise InputError("use_free_space must be False or None for a map without free voxels, got True.")
    use_free = has_free if use_free_space is None else use_free_space
    index = grid.occupied_index()
    points = grid.occupied_points()
    # Points are centred before they become float32, so that maps far from their origin keep their digits.
    center = points.mean(axis=0) if len(points) else np.zeros(3)
    centred = points - center
    toward_free = _toward_free(grid, index) if use_free else None
    first = finest_level(grid, spacing=spacing) if finest is None else finest
    levels = []
    # Rooms full of small things match at the fine scale, halls at the next.
    for level in range(first, max(first, 1) + 1):
        cell, means = average_by_cell(centred, _scale(level) * spacing)
        side = None if toward_free is None else sum_by_cell(cell, toward_free, len(means))
        levels.append(_describe_level(means, side, _scale(level) * spacing))
    return MapDescriptors(tuple(levels), center, "free" if use_free else "surroundings")


def match_descriptors(
    a: DescriptorLevel, b: DescriptorLevel
) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, "k"]]:
    """Match the points of two maps whose descriptors are each other's nearest.

    Args:
        a: One level of the first map.
        b: Level of the second map that has the same spacing.

    Returns:
        Rows of a and b, int32 (k, 2), in the order of a, and the squared descriptor distances (k,).

    Raises:
        InputError: If the levels have different spacings.
    """
    # Voxel sizes that went through float32 or text differ in their last digits, and so do the spacings.
    if not np.isclose(a.spacing, b.spacing, rtol=1e-5):
        raise InputError(
            f"descriptors must have the same spacing in both maps, got {a.spacing:g} m and {b.spacing:g} m; "
            "describe both with spacing=working_spacing(voxel_size_a, voxel_size_b)."
        )
    descriptors = [np.asarray(level.descriptors) for level in (a, b)]
    everything = [np.ones(len(rows), bool) for rows in descriptors]
    nearest, is_mutual, square = (np.asarray(x) for x in mutual_nearest(*descriptors, *everything))
    rows = np.flatnonzero(is_mutual)
    return np.stack([rows, nearest[rows]], axis=1).astype(np.int32), square[rows]


def _scale(level: int) -> float:
    """Cells of a level over those of the working spacing."""
    return 1.6**level


def _describe_level(points: np.ndarray, side: np.ndarray | None, spacing: float) -> DescriptorLevel:
    """Normals of the averaged points, their signs (toward `side`, or the surroundings), and descriptors."""
    tree = point_tree(points)
    normal_tiles, tiles = (near_tiles(tree, r * spacing) for r in (NORMAL_RADIUS, DESCRIPTOR_RADIUS))
    placed = points.astype(np.float32)
    normals = np.array(surface_normals(placed, normal_tiles, radius=NORMAL_RADIUS * spacing)[0])
    side = toward_surroundings(points, 4.0 * spacing) if side is None else side
    # The histograms hold signed angles between normals, so both maps must sign theirs by one rule.
    normals *= np.where(np.sum(normals * side, axis=1) < 0.0, -1.0, 1.0)[:, None]
    descriptors = point_feature_histograms(
        placed, normals, tiles, radius=DESCRIPTOR_RADIUS * spacing, spacing=spacing
    )
    return DescriptorLevel(placed, normals, np.asarray(descriptors), spacing)


def _toward_free(grid: VoxelGrid, index: np.ndarray) -> np.ndarray:
    """`_free_directions` of a map of any size."""
    reach = 2

    def directions(states: np.ndarray, low: np.ndarray, rows: Rows) -> np.ndarray:
        return _free_directions(states, index[rows] - low.astype(np.int32), reach)

    return over_tiles(directions, grid.states_in, index, grid.shape, halo=reach)


def _free_directions(states: np.ndarray, index: np.ndarray, reach: int) -> np.ndarray:
    """Sum of the unit directions from each listed voxel to the free voxels up to so many steps away: (n, 3)."""
    # Voxels whose surroundings are looked up at once: one core works on them while others do the next.
    chunk = 1 << 14
    # The rim keeps steps at the border of the map from wrapping into the next row; bytes can be added as they
    # are.
    is_free = np.pad(states == FREE, reach).view(np.int8)
    strides = np.array([is_free.shape[1] * is_free.shape[2], is_free.shape[2], 1], np.int64)
    flat, places = is_free.reshape(-1), (index.astype(np.int64) + reach) @ strides
    total = np.zeros((3, len(index)), np.float32)

    def add(first: int) -> None:
        part = slice(first, first + chunk)
        start = places[part]
        for step in np.ndindex(3, 3, 3):
            # All 26 directions are asked, so that slanted surfaces are not pulled toward the axes.
            direction = np.array(step, np.int64) - 1
            if not direction.any():
                continue
            jump = direction @ strides
            count = np.take(flat, start + jump)
            for distance in range(2, reach + 1):
                count += np.take(flat, start + distance * jump)
            weights = count.astype(np.float32)
            unit = (direction / np.linalg.norm(direction)).astype(np.float32)
            for axis in np.flatnonzero(direction):
                total[axis, part] += unit[axis] * weights

    spread(add, range(0, len(index), chunk))
    return total.T
