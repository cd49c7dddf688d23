"""Observed corners: three fitted planes that meet at a point with their faces beside it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32

from ..grid import VoxelGrid
from ..ops.blocks.over_tiles import Rows, over_tiles
from ..ops.surface.faces import OCTANT_SIGNS, CornerFaces, corner_faces, faces_reach

_BITS = (1, 2, 4)

Part = tuple[np.ndarray, np.ndarray, np.ndarray, int, int]
"""Where a kind of corner is (m,), how much of it was seen (m,), signs of the normals (3,), kind, first row."""


class FoundCorners(NamedTuple):
    """Corners before suppression: candidate row, signed normals, kind and share of the faces that was seen."""

    row: Int32[np.ndarray, "k"]
    normals: Float[np.ndarray, "k 3 3"]
    convexity: Int32[np.ndarray, "k"]
    coverage: Float[np.ndarray, "k"]


class _Shares(NamedTuple):
    """`CornerFaces` on the host."""

    seen: np.ndarray
    occupied: np.ndarray
    free: np.ndarray


def observe_corners(
    grid: VoxelGrid,
    position: Float[np.ndarray, "m 3"],
    normals: Float[np.ndarray, "m 3 3"],
    *,
    min_seen: float = 0.4,
    max_beyond: float = 0.35,
    reach: float = 4.5,
) -> FoundCorners:
    """Look at the map around points where three planes meet, and tell which kinds of corner are there.

    Args:
        grid: The map.
        position: Points [m].
        normals: Unit normals of the three planes, rows, either sign.
        min_seen: A face of a corner is there if this share of its samples is occupied before free space.
        max_beyond: A face ends at a convex edge if no more than this share of the samples beyond it is
            occupied.
        reach: How far from the point to look [voxel].

    Returns:
        `FoundCorners`; a point can hold several (four rooms that meet) or none.
    """
    # Places become voxels whose centres have whole coordinates; float64 lasts until the origin is taken off.
    local = (position - np.asarray(grid.origin, np.float64)) / grid.voxel_size - 0.5
    # Coordinates stay those of the whole box: in a tile's own they would be rounded otherwise.
    places, planes = local.astype(np.float32), normals.astype(np.float32)

    def look(states: np.ndarray, low: np.ndarray, rows: Rows) -> CornerFaces:
        return corner_faces(states, places[rows], planes[rows], low=low.astype(np.int32), last=reach)

    # Points beyond the box see no more of it than the nearest voxel inside does.
    nearest = np.clip(np.rint(local), 0, np.maximum(np.asarray(grid.shape) - 1, 0)).astype(np.int64)
    faces = over_tiles(look, grid.states_in, nearest, grid.shape, halo=faces_reach(reach))
    shares = _Shares(*map(np.asarray, faces))
    return _decode(shares, np.asarray(normals, np.float64), min_seen, max_beyond)


def _decode(faces: _Shares, normals: np.ndarray, min_seen: float, max_beyond: float) -> FoundCorners:
    """All kinds of corner in all octants."""
    parts = []
    for octant in range(8):
        parts.append(_concave(faces, octant, min_seen))
        parts.append(_convex(faces, octant, min_seen, max_beyond))
        for face in range(3):
            parts.append(_one_convex_edge(faces, octant, face, min_seen, max_beyond))
            parts.append(_two_convex_edges(faces, octant, face, min_seen, max_beyond))
    rows, out, kinds, shares = [], [], [], []
    for is_there, coverage, signs, kind, first in parts:
        row = np.flatnonzero(is_there)
        rows.append(row)
        out.append(right_handed(normals[row] * signs[None, :, None], first))
        kinds.append(np.full(len(row), kind))
        shares.append(coverage[row])
    return FoundCorners(
        np.concatenate(rows).astype(np.int32),
        np.concatenate(out),
        np.concatenate(kinds).astype(np.int32),
        np.concatenate(shares),
    )


def _concave(faces: _Shares, octant: int, min_seen: float) -> Part:
    """The corner of a room: a free octant with its three faces."""
    # A corner counts as seen as much as that of its faces which was seen least.
    coverage = faces.seen[:, octant].min(axis=1)
    is_there = (coverage >= min_seen) & (faces.free[:, octant] >= 0.5)
    return is_there, coverage, OCTANT_SIGNS[octant], 0, 0


def _convex(faces: _Shares, octant: int, min_seen: float, max_beyond: float) -> Part:
    """The corner of a box: a solid octant whose faces are seen from the three octants beside it."""
    # An exclusive or with bit i leads to the octant on the other side of plane i.
    coverage = np.stack([faces.seen[:, octant ^ _BITS[i], i] for i in range(3)]).min(axis=0)
    beyond = [faces.occupied[:, octant ^ _BITS[j], i] for i in range(3) for j in range(3) if i != j]
    is_there = (
        (coverage >= min_seen) & (np.max(beyond, axis=0) <= max_beyond) & (faces.free[:, octant] <= 0.3)
    )
    return is_there, coverage, -OCTANT_SIGNS[octant], 3, 0


def _one_convex_edge(faces: _Shares, octant: int, base: int, min_seen: float, max_beyond: float) -> Part:
    """The foot of a box: a solid octant on a base face that goes on around it."""
    i, j = (base + 1) % 3, (base + 2) % 3
    around = [octant ^ _BITS[i], octant ^ _BITS[j], octant ^ _BITS[i] ^ _BITS[j]]
    # Two of the three octants around must show the base; in the third something may hide it.
    ground = np.sort(np.stack([faces.seen[:, o, base] for o in around]), axis=0)[1]
    coverage = np.minimum(np.minimum(faces.seen[:, around[0], i], faces.seen[:, around[1], j]), ground)
    beyond = np.maximum(faces.occupied[:, around[1], i], faces.occupied[:, around[0], j])
    is_there = (coverage >= min_seen) & (beyond <= max_beyond) & (faces.free[:, octant] <= 0.3)
    signs = -OCTANT_SIGNS[octant]
    signs[base] = -signs[base]
    return is_there, coverage, signs, 1, base


def _two_convex_edges(faces: _Shares, octant: int, face: int, min_seen: float, max_beyond: float) -> Part:
    """The corner of an opening in `face`: a free octant inside it, with two faces of the opening."""
    i, j = (face + 1) % 3, (face + 2) % 3
    before = octant ^ _BITS[face]
    around = [before ^ _BITS[i], before ^ _BITS[j], before ^ _BITS[i] ^ _BITS[j]]
    # Two of the three octants before the face must show it, as for the base of a foot.
    front = np.sort(np.stack([faces.seen[:, o, face] for o in around]), axis=0)[1]
    coverage = np.minimum(np.minimum(faces.seen[:, octant, i], faces.seen[:, octant, j]), front)
    beyond = np.stack(
        [faces.occupied[:, octant, face], faces.occupied[:, before, i], faces.occupied[:, before, j]]
    )
    is_there = (coverage >= min_seen) & (beyond.max(axis=0) <= max_beyond) & (faces.free[:, octant] >= 0.5)
    signs = OCTANT_SIGNS[octant].copy()
    signs[face] = -signs[face]
    return is_there, coverage, signs, 2, face


def right_handed(normals: Float[np.ndarray, "k 3 3"], first: int = 0) -> Float[np.ndarray, "k 3 3"]:
    """Rows rolled so that row `first` comes first, the two others swapped where the triple product is negative."""
    rolled = np.roll(normals, -first, axis=1)
    product = np.einsum("ki,ki->k", rolled[:, 0], np.cross(rolled[:, 1], rolled[:, 2]))
    return np.where((product < 0)[:, None, None], rolled[:, [0, 2, 1]], rolled)
