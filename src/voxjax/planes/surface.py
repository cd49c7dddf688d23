"""The surface of a map as a list of elements: one for each side of an occupied voxel that faces free space."""

from itertools import product

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float32, Int32

from ..grid import VoxelGrid
from ..ops.surface.moments import tiled_moments


class Surface(eqx.Module):
    """Surface elements of a map, in voxel coordinates (the centre of voxel (i, j, k) is (i, j, k)).

    A wall one voxel thick that was seen from both sides has two elements a voxel, with opposite normals.

    Attributes:
        index: int32 (n, 3): the voxel of each element.
        normal: float32 (n, 3): unit normals, into free space where `is_signed`.
        curvature: float32 (n,): 0 on a plane, up to 1/3.
        is_signed: bool (n,): whether free space was seen beside the element.
        pairs: int32 (m, 2): elements of touching voxels whose normals do not oppose each other.
    """

    index: Int32[np.ndarray, "n 3"]
    normal: Float32[np.ndarray, "n 3"]
    curvature: Float32[np.ndarray, "n"]
    is_signed: Bool[np.ndarray, "n"]
    pairs: Int32[np.ndarray, "m 2"]


def find_surface(grid: VoxelGrid, *, size: int = 7, reach: int = 3, min_neighbours: int = 6) -> Surface:
    """List the surface elements of a map.

    Args:
        grid: The map.
        size: Diameter of the window for normals and curvature [voxel].
        reach: How far from a voxel free space may begin [voxel]; walls thicker than twice this keep a core
            without elements.
        min_neighbours: Voxels with fewer occupied voxels in the window (scan noise) get no element.

    Returns:
        `Surface`. In a map without free space every voxel has one element, not signed.
    """
    index = grid.occupied_index()
    moments = tiled_moments(grid.states_in, grid.shape, index, size=size, reach=reach)
    normal, curvature, num_occupied, has_free, _, distance = map(np.asarray, moments)
    forward, backward = distance.T.astype(np.int32)
    is_solid = num_occupied >= min_neighbours
    # A voxel belongs to the side that is nearer to free space; to both where they are equally near.
    is_front = is_solid & (forward <= reach) & (forward <= backward)
    is_back = is_solid & (backward <= reach) & (backward <= forward)
    # Voxels whose free space is farther than the reach, or nowhere, still belong to a surface, with one
    # element.
    is_unseen = is_solid & ~is_front & ~is_back
    is_signed_by_mean = is_unseen & has_free
    # These are the rows of each voxel's front and back element in the result, which has all front ones first.
    node = np.full((2, len(index)), -1, np.int32)
    front = is_front | is_unseen
    node[0, front] = np.arange(np.count_nonzero(front))
    node[1, is_back] = np.count_nonzero(front) + np.arange(np.count_nonzero(is_back))
    pairs = _element_pairs(neighbour_pairs(index), node, normal, ~(is_unseen & ~has_free))
    return Surface(
        index=np.concatenate([index[front], index[is_back]]),
        normal=np.concatenate([normal[front], -normal[is_back]]),
        curvature=np.concatenate([curvature[front], curvature[is_back]]),
        is_signed=np.concatenate([(is_front | is_signed_by_mean)[front], is_back[is_back]]),
        pairs=pairs,
    )


def _element_pairs(
    pairs: np.ndarray, node: np.ndarray, normal: np.ndarray, is_signed: np.ndarray
) -> np.ndarray:
    """Pairs of elements of touching voxels that lie on the same side of the surface."""
    i, j = pairs.T
    cosine = np.einsum("ij,ij->i", normal[i], normal[j])
    # Elements that know no side agree with either.
    is_free = ~(is_signed[i] & is_signed[j])
    node_i, node_j = node[:, i], node[:, j]
    found = []
    for side_i in (0, 1):
        for side_j in (0, 1):
            # The normal of a back element is the voxel's own, reversed.
            agreement = cosine if side_i == side_j else -cosine
            joined = (node_i[side_i] >= 0) & (node_j[side_j] >= 0) & (is_free | (agreement > 0.0))
            found.append(np.stack([node_i[side_i][joined], node_j[side_j][joined]]))
    # Columns contiguous: all that follows reads the first and the second of the pairs apart.
    return np.concatenate(found, axis=1).T


def neighbour_pairs(index: Int32[np.ndarray, "n 3"]) -> Int32[np.ndarray, "m 2"]:
    """Pairs of rows whose voxels share a face, an edge or a corner, each pair once.

    Args:
        index: Distinct voxel indices in lexicographic order, as `VoxelGrid.occupied_index` gives them.

    Returns:
        int32 (m, 2) row numbers, smaller index first; each column is contiguous in memory.
    """
    if len(index) == 0:
        return np.zeros((0, 2), np.int32)
    # A border of one voxel on each side keeps steps from wrapping into the next row of the key.
    local = index.astype(np.int64) - index.min(axis=0) + 1
    shape = local.max(axis=0) + 2
    strides = np.asarray([shape[1] * shape[2], shape[2], 1])
    keys = local @ strides
    rows = np.arange(len(keys), dtype=np.int32)
    pairs = []
    for step in product((-1, 0, 1), repeat=3):
        # Of each direction and its opposite one is taken: pairs come once, with the smaller row first.
        if step > (0, 0, 0):
            wanted = keys + int(np.dot(step, strides))
            found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            hit = keys[found] == wanted
            pairs.append(np.stack([rows[hit], found[hit].astype(np.int32)]))
    return np.concatenate(pairs, axis=1).T
