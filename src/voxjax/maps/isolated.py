"""Isolated far pieces of a map: a few stray voxels that make its box many times as large as what it shows.

The rule has no length of its own. A set of voxels is closed if every voxel outside of it is farther from it than the
set is large (the diagonal of its box). Closed sets lie inside or beside each other and never cross, so that there is
one smallest among those that hold nearly all voxels: that set is the map's main part, and what is left over is
isolated. Two buildings of like size are one main part however far apart they stand, and rings that thin out belong to
it as long as each gap is smaller than what lies within.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Real
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree


class IsolatedPieces(NamedTuple):
    """What of a map is isolated, piece by piece, the farthest first.

    Attributes:
        piece: int32 (n,): number of the piece that a point belongs to; -1 for the main part.
        num_voxels: int64 (m,): how many voxels each piece has.
        distance: float64 (m,): from each piece to the main part, between the nearest centres, in the points' unit.
        low: float64 (3,): low corner of the space that belongs to the main part: its box, on each side wider by
            its diagonal. Free space beyond was seen by rays to isolated pieces.
        high: float64 (3,): its high corner.
        sides: float64 (3,): how large the box of the main part is.
        voxel_size: Width of a voxel, in the points' unit too.
    """

    piece: np.ndarray
    num_voxels: np.ndarray
    distance: np.ndarray
    low: np.ndarray
    high: np.ndarray
    sides: np.ndarray
    voxel_size: float


def isolated_pieces(
    points: Real[np.ndarray, "n 3"], *, voxel_size: float = 1.0, weights: Real[np.ndarray, " n"] | None = None
) -> IsolatedPieces:
    """Find the isolated far pieces of what is occupied: at most 2 % of the voxels in all.

    The time is that of a few passes over the points, and that of a nearest-neighbour tree where a piece is found; the
    memory is linear in their number, whatever box they span.

    Args:
        points: Finite centres of occupied voxels [m], each voxel once, or their indices.
        voxel_size: Width of a voxel in the unit of the points; 1 for indices.
        weights: How many voxels each point stands for; None for one each.

    Returns:
        The pieces; none (arrays of length 0) in most maps, and never of fewer than 50 voxels. A piece is a group of
        cells that touch; the cells are a quarter of the extent of nearly all voxels wide.
    """
    # Below 1/33 the core found here belongs to the main part: see `is_sure`.
    share = 0.02
    places = np.asarray(points, np.float64)
    mass = np.ones(len(places)) if weights is None else np.asarray(weights, np.float64)
    most = float(np.floor(share * mass.sum()))
    if not len(places) or most < mass.min():
        return _pieces(places, mass, np.zeros(len(places), np.int32), np.zeros(1), voxel_size)
    low, high = _sure_box(places, None if weights is None else mass, most)
    width = float(np.linalg.norm(high - low + voxel_size)) / 4.0
    group, number = _touching_cells(places, low, width)
    # Six times `share` at most lies outside of the sure box, which is no more than four cells and a border wide. Of its
    # groups, 27 at most, the largest then holds more than `share`, so that the main part has it; and since the steps
    # inside a group are smaller than the sure box, and so than the main part, groups belong to it whole or not at all.
    is_sure = ((places >= low) & (places <= high)).all(axis=1)
    inside = np.bincount(group[is_sure], mass[is_sure], minlength=number)
    distance = _distance_of_groups(places, mass, group, int(inside.argmax()), most, voxel_size)
    return _pieces(places, mass, group, distance, voxel_size)


def _sure_box(places: np.ndarray, mass: np.ndarray | None, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,) of a box that the box of any part without at most `most` voxels contains."""
    if mass is None:
        # Of the `most` + 1 lowest voxels along an axis, the part holds one at least.
        index = [int(most), len(places) - 1 - int(most)]
        ends = np.stack([np.partition(places[:, axis], index)[index] for axis in range(3)], axis=1)
        return np.minimum(*ends), np.maximum(*ends)
    ends = np.empty((2, 3))
    for axis in range(3):
        order = np.argsort(places[:, axis])
        below = np.cumsum(mass[order])
        above = below[-1] - below + mass[order]
        ends[0, axis] = places[order[np.flatnonzero(below > most)[0]], axis]
        ends[1, axis] = places[order[np.flatnonzero(above > most)[-1]], axis]
    return np.minimum(*ends), np.maximum(*ends)


def _touching_cells(places: np.ndarray, low: np.ndarray, width: float) -> tuple[np.ndarray, int]:
    """Groups of points whose cells of that width touch: number of each point's group int32 (n,), and how many."""
    # Keys of three times 21 bits; cells beyond a million widths are taken for one, far from all others anyway.
    reach = 1 << 20
    key = np.zeros(len(places), np.int64)
    for axis in range(3):
        cell = np.floor((places[:, axis] - low[axis]) / width).clip(-reach, reach - 1).astype(np.int64)
        key = (key << 21) + (cell + reach)
    cells, at = np.unique(key, return_inverse=True)
    index = np.stack([cells >> 42, cells >> 21 & 0x1FFFFF, cells & 0x1FFFFF], axis=1)
    pairs = KDTree(index).query_pairs(1.0, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(cells), len(cells)))
    number, group = connected_components(links, directed=False)
    return group.astype(np.int32)[at], number


def _distance_of_groups(
    places: np.ndarray, mass: np.ndarray, group: np.ndarray, core: int, most: float, voxel_size: float
) -> np.ndarray:
    """Distance float64 (m,) of each group to the smallest closed set around the group `core`, 0 for those in the set.

    Args:
        places: float64 (n, 3).
        mass: float64 (n,): voxels that each point stands for.
        group: int32 (n,): number of each point's group.
        core: Number of a group that belongs to the set.
        most: How many voxels the set may leave out.
        voxel_size: Width of a voxel.
    """
    held = np.bincount(group, mass)
    # One point of each group gives upper bounds of distances, which spare most maps the tree of all points.
    some = np.empty(len(held), np.int64)
    some[group] = np.arange(len(group))
    is_main = np.arange(len(held)) == core
    while not is_main.all():
        main = places[is_main[group]]
        size = float(np.linalg.norm(main.max(axis=0) - main.min(axis=0) + voxel_size))
        distance = _distances(places[some], np.arange(len(held)), is_main)
        if not (distance[~is_main] <= size).any():
            distance = _distances(places, group, is_main)
            if not (distance[~is_main] <= size).any():
                if held[~is_main].sum() <= most:
                    return distance
                # Any larger closed set has the nearest point that is left, too.
                size = distance[~is_main].min()
        is_main |= distance <= size
    return np.zeros(len(held))


def _distances(places: np.ndarray, group: np.ndarray, is_main: np.ndarray) -> np.ndarray:
    """Distance float64 (m,) of each group to the nearest point of the main ones, which have 0."""
    in_main = is_main[group]
    # An unbalanced tree of large leaves is made twice as fast, and serves few queries as well.
    tree = KDTree(places[in_main], leafsize=64, balanced_tree=False, compact_nodes=False)
    nearest, _ = tree.query(places[~in_main], workers=-1)
    distance = np.where(is_main, 0.0, np.inf)
    np.minimum.at(distance, group[~in_main], nearest)
    return distance


def _pieces(
    places: np.ndarray, mass: np.ndarray, group: np.ndarray, distance: np.ndarray, voxel_size: float
) -> IsolatedPieces:
    """Number the groups that are not main, the farthest first, and measure the space of the main part."""
    low = high = np.zeros(3)
    if len(places):
        main = places[distance[group] == 0]
        low, high = main.min(axis=0) - voxel_size / 2, main.max(axis=0) + voxel_size / 2
    diagonal = np.linalg.norm(high - low)
    order = np.argsort(-distance, kind="stable")[: np.count_nonzero(distance)]
    number = np.full(len(distance), -1, np.int32)
    number[order] = np.arange(len(order))
    held = np.bincount(group, mass, minlength=len(distance))[order]
    return IsolatedPieces(
        number[group],
        np.rint(held).astype(np.int64),
        distance[order],
        low - diagonal,
        high + diagonal,
        high - low,
        voxel_size,
    )
