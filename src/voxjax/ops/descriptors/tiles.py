"""Points in small tiles, and which tiles lie within a radius of each other: all pairs of near points, without lists.

A tile is a leaf of a tree of halves, so its points lie close together. Work on pairs of points is done tile against
tile, densely: most pairs of points of near tiles are too far apart, but no distance is looked up or sorted. On the
host: the structure is indices only, and kernels take it as arrays.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32

from ..._checks import InputError, check_positive
from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.threads import spread
from ..._types import Array

TILE = 16
"""Points of a tile."""
LEAF = 8
"""Points of a half tile: the others of a pair of tiles are listed half by half, which fits the ball more closely."""
GROUP = 16
"""Half tiles of an item: at most 128 others, which a byte can count."""


class NearTiles(NamedTuple):
    """Tiles of points, and which of them are near each other.

    Attributes:
        rows: int32 (2 t, LEAF): rows of the points by half tile; tile i has the half tiles 2 i and 2 i + 1. The number
            of points (no row) where a place is empty.
        own: int32 (m,): tile of each item, ascending.
        others: int32 (m, GROUP): half tiles near it, at distances up to the radius; a half tile without points (the
            last, there is always one) where there are no more. A tile has as many items as it needs.
    """

    rows: Int32[Array, "l 8"]
    own: Int32[Array, "m"]
    others: Int32[Array, "m 16"]


class PointTree(NamedTuple):
    """A tree of halves over points: level k has 2**k nodes, the last one the half tiles.

    Attributes:
        rows: int64 (l, LEAF): rows of the points by half tile; the number of points where a place is empty.
        low: Least coordinates of the nodes of each level, float32 (3, 2**k); infinite for nodes without points.
        high: Largest coordinates of the nodes of each level; -infinite for nodes without points.
    """

    rows: np.ndarray
    low: list[np.ndarray]
    high: list[np.ndarray]


def point_tree(points: Float[np.ndarray, "n 3"]) -> PointTree:
    """Halve points at the median of their longest extent, down to half tiles.

    Args:
        points: Finite, n >= 0.

    Raises:
        InputError: If a coordinate is not finite.
    """
    count = len(points)
    if not np.isfinite(points).all():
        raise InputError("points must have finite coordinates, got an infinite one or NaN.")
    # There are leaves for all points and for one more, empty, with which lists of near half tiles are filled up; and at
    # least two, for a tile has two.
    levels = max(int(np.ceil(np.log2(max(count + LEAF, 2 * LEAF) / LEAF))), 1)
    size = LEAF << levels
    # Empty places are infinitely far, so the points of a node come before them, and the last leaf is empty.
    columns = np.full((3, size), np.inf, np.float32)
    columns[:, :count] = np.asarray(points, np.float32).T
    rows = np.minimum(np.arange(size), count)
    # The first levels are made by one thread, and their parts side by side; which points a part has is no matter of
    # how many cores there are.
    top = min(2, levels)
    _halve(columns, rows, top)
    parts = list(zip(np.split(columns, 1 << top, axis=1), np.split(rows, 1 << top), strict=True))
    spread(lambda part: _halve(*part, levels - top), parts)
    low, high = (np.full((3, 1 << levels), bound, np.float32) for bound in (np.inf, -np.inf))
    filled = -(-count // LEAF)
    low[:, :filled], high[:, :filled] = _boxes(columns[:, : filled * LEAF], LEAF)
    # A partition leaves its halves in any order; sorted, the rows of a leaf are in one, and empty places come last.
    rows = np.sort(rows.reshape(-1, LEAF), axis=1)
    lows, highs = [low], [high]
    for _ in range(levels):
        low, high = low.reshape(3, -1, 2).min(axis=2), high.reshape(3, -1, 2).max(axis=2)
        lows.append(low)
        highs.append(high)
    return PointTree(rows, lows[::-1], highs[::-1])


def _halve(columns: np.ndarray, rows: np.ndarray, levels: int) -> None:
    """Bring points (3, n) and their rows, in place, into the order of a tree of so many levels.

    Points fill a tree from the first leaf on, and nodes without points are left alone.
    """
    size, count = len(rows), np.count_nonzero(np.isfinite(columns[0]))
    for level in range(levels):
        width = size >> level
        nodes = -(-count // width)
        points = columns[:, : nodes * width]
        low, high = _boxes(points, width)
        axis = np.argmax(high - low, axis=0)
        keys = np.take_along_axis(points.reshape(3, nodes, width), axis[None, :, None], axis=0)[0]
        # Half of the points go to either side, however they are spread: all leaves but the last are full, and the tree
        # needs no links. Empty places are infinite along each axis, so they stay behind the points.
        halves = np.argpartition(keys, width // 2 - 1, axis=1)
        halves += (np.arange(nodes) * width)[:, None]
        halves = halves.reshape(-1)
        columns[:, : len(halves)], rows[: len(halves)] = np.take(points, halves, axis=1), rows[halves]


def _boxes(columns: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates of nodes of equal width; all hold points, and only the last empty places too."""
    # Places of a node up to which its box is found by halves.
    short = 64
    low = high = columns.reshape(3, -1, width)
    # In halves, whose number is a power of two: NumPy reduces short rows one number at a time.
    while 1 < low.shape[2] <= short:
        half = low.shape[2] // 2
        low = np.minimum(low[:, :, :half], low[:, :, half:])
        high = np.maximum(high[:, :, :half], high[:, :, half:])
    low, high = low.min(axis=2), high.max(axis=2)
    # The infinity of empty places never is the least coordinate, but it would be the largest.
    last = columns[:, -width:]
    finite = np.where(np.isfinite(last), last, -np.inf)
    high[:, -1:] = finite.max(axis=1, keepdims=True, initial=-np.inf)
    return low, high


def near_tiles(tree: PointTree, radius: float) -> NearTiles:
    """Find the half tiles within a radius of each tile.

    Args:
        tree: Tree of the points, see `point_tree`.
        radius: Distance [m, as the points]; every pair of points at most so far apart is in the result.

    Returns:
        `NearTiles`, as NumPy arrays; without items where there is no point.

    Raises:
        InputError: If the radius is not positive.
    """
    # A little more, for the rounding of squares; kernels compare distances themselves.
    square = np.float32((1 + 1e-5) * check_positive("radius", radius, "m") ** 2)
    level = len(tree.low) - 2
    # The level above the leaves has the tiles. A box that is inside out holds no point.
    tiles = np.flatnonzero(tree.low[level][0] <= tree.high[level][0])
    # Tiles of one search: pairs of a few hundred tiles and what is near them stay small, and all cores have some.
    chunk = 512
    parts = spread(
        lambda first: _descend(tree, tiles[first : first + chunk], square), range(0, len(tiles), chunk)
    )
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    own, other = (np.concatenate(part) for part in zip(none, *parts, strict=True))
    # The tree fills its places from the first on.
    return _grouped(tree.rows[: 2 * (len(tiles) + 1)], own, other)


def _descend(tree: PointTree, own: np.ndarray, square: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of the given tiles and the half tiles near them, from the root down; in the order of the tiles."""
    levels = len(tree.low) - 1
    low, high = tree.low[levels - 1], tree.high[levels - 1]
    other, level = np.zeros(len(own), np.int64), 0
    while level < levels:
        # Three levels at once: eight times the boxes are looked at, in a third of the calls.
        step = min(3, levels - level)
        level += step
        own = np.repeat(own, 1 << step)
        other = ((other << step)[:, None] + np.arange(1 << step)).reshape(-1)
        # The squared distance of two boxes: 0 along an axis where they overlap, infinite where one has no points.
        gap = np.zeros(len(own), np.float32)
        for axis in range(3):
            before = tree.low[level][axis][other] - high[axis][own]
            behind = low[axis][own] - tree.high[level][axis][other]
            side = np.maximum(np.maximum(before, behind), np.float32(0))
            gap += side * side
        is_near = gap <= square
        own, other = own[is_near], other[is_near]
    return own, other


def _grouped(rows: np.ndarray, own: np.ndarray, other: np.ndarray) -> NearTiles:
    """Lists of half tiles by tile, cut into items of GROUP."""
    empty = len(rows) - 1
    starts = np.flatnonzero(np.diff(own, prepend=-1))
    counts = np.diff(starts, append=len(own))
    items = -(-counts // GROUP)
    others = np.full((int(items.sum()), GROUP), empty, np.int32)
    # Each tile begins an item of its own, so its half tiles move on by the places that tiles before it left empty.
    place = np.arange(len(own)) + np.repeat(GROUP * (np.cumsum(items) - items) - starts, counts)
    others.reshape(-1)[place] = other
    return NearTiles(rows.astype(np.int32), np.repeat(own[starts], items).astype(np.int32), others)


def padded_tiles(near: NearTiles, count: int, size: int) -> NearTiles:
    """Tiles for `count` points padded to `size` rows, with items on the ladder of sizes.

    Accelerators need this, where a list belongs to the shape of the kernel; the items added hold no pair.
    """
    items, half_tiles = bucket_size(len(near.own), 1024), 2 * (-(-size // TILE) + 1)
    # Empty places name the row after the last point, which the padding has moved.
    rows = pad_rows(np.where(near.rows < count, near.rows, size).astype(np.int32), half_tiles, size)
    own, others = np.asarray(near.own), np.asarray(near.others)
    return NearTiles(rows, pad_rows(own, items), pad_rows(others, items, len(near.rows) - 1))
