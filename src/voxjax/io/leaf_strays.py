"""Isolated far pieces of a map as leaves: found, and left out, as `strays` does it with the voxels of a dense map."""

import numpy as np

from .._types import OCCUPIED
from ..maps.isolated import IsolatedPieces, isolated_pieces
from .leaves import NUM_KEYS, LeafMap, Leaves, pieces


def stray_bytes(leaves: LeafMap) -> float:
    """Memory that `split_leaves` takes, the leaves among it [byte]."""
    # Bytes that were seen for a sample.
    return leaves.num_bytes + 125.0 * sum(_num_samples(leaves, _samples_along(leaves)))


def split_leaves(leaves: LeafMap) -> tuple[LeafMap, IsolatedPieces]:
    """Look for isolated pieces of a map; wide leaves stay whole.

    Args:
        leaves: The map.

    Returns:
        The map without these pieces and without the free space that was seen on the way to them, the given one if there
        are none; and the pieces, in metres of the map's frame. Their `piece` numbers samples of leaves.
    """
    side = _samples_along(leaves)
    ends = np.cumsum([0, *_num_samples(leaves, side)]).tolist()
    places, weights = np.empty((ends[-1], 3), np.int32), np.empty(ends[-1])
    for level, start in zip(leaves.levels, ends, strict=False):
        _write_samples(leaves, level, min(side, level.width), places[start:], weights[start:])
    # Points that all stand for one voxel need no weights, and no sorting by them.
    found = isolated_pieces(places, weights=None if (weights == 1.0).all() else weights)
    found = _in_metres(found, leaves.resolution)
    if not len(found.distance):
        return leaves, found
    kept = []
    for level, start, end in zip(leaves.levels, ends, ends[1:], strict=False):
        # Voxels of one leaf touch, so that they are of one piece; the first of its samples speaks for all.
        piece = found.piece[start : end : min(side, level.width) ** 3]
        stays = np.ones(len(level.key), bool)
        stays[level.states() == OCCUPIED] = piece < 0
        kept.append(level.where(stays))
    return leaves.with_levels(kept).within((found.low, found.high)), found


def _in_metres(found: IsolatedPieces, resolution: float) -> IsolatedPieces:
    """Pieces that were found among keys, in the frame of the file."""
    # A key counts from OctoMap's lowest voxel, whose centre is half a voxel from its corner.
    shift = 0.5 - NUM_KEYS // 2
    return found._replace(
        distance=found.distance * resolution,
        low=(found.low + shift) * resolution,
        high=(found.high + shift) * resolution,
        sides=found.sides * resolution,
        voxel_size=resolution,
    )


def _samples_along(leaves: LeafMap) -> int:
    """How many voxels along each edge of an occupied leaf stand for it: all, up to 8, unless those are too many."""
    # Solid blocks would take memory by their volume; a few times that of the leaves is granted, or that of a small map.
    most = max(2 * leaves.num_leaves, 1 << 18)
    return next((side for side in (8, 4, 2) if sum(_num_samples(leaves, side)) <= most), 1)


def _num_samples(leaves: LeafMap, side: int) -> list[int]:
    """Number of samples of each level with that many along the edge of a leaf that is as wide."""
    return [
        int(np.count_nonzero(level.states() == OCCUPIED)) * min(side, level.width) ** 3
        for level in leaves.levels
    ]


def _write_samples(
    leaves: LeafMap, level: Leaves, side: int, places: np.ndarray, weights: np.ndarray
) -> None:
    """Voxels spread over each occupied leaf of a level, its corners among them; a single one is its middle.

    Args:
        leaves: The map, whose window cuts the leaves.
        level: One of its levels.
        side: How many voxels along each edge of a leaf.
        places: int32 (m, 3): its first rows get their keys.
        weights: float64 (m,): its first places get how many voxels each stands for.
    """
    steps, end = np.arange(side) / (side - 1) if side > 1 else np.full(1, 0.5), 0
    for piece in pieces(level):
        low, high = leaves.boxes(piece.where(piece.states() == OCCUPIED))
        # Of the extent less one: the first step is the lowest voxel and the last step the highest.
        along = low[:, :, None] + np.rint((high - low - 1)[:, :, None] * steps).astype(np.int64)
        begin, end = end, end + len(low) * side**3
        rows = places[begin:end].reshape(-1, side, side, side, 3)
        rows[..., 0] = along[:, 0, :, None, None]
        rows[..., 1] = along[:, 1, None, :, None]
        rows[..., 2] = along[:, 2, None, None, :]
        weights[begin:end] = np.repeat((high - low).prod(axis=1, dtype=np.int64) / side**3, side**3)
