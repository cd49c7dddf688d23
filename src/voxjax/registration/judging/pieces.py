"""Voxels of a map that hang together, and where a pose puts them in the other map."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ...maps.prepared import PreparedMap
from ...ops.evidence.lookup import cells_on_host, turned_on_host


def cells_of_points(
    target: PreparedMap, points: Float[np.ndarray, "n 3"], T: np.ndarray
) -> tuple[Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Cells of the pools of a map where a pose puts points [m], 0 outside, and whether they lie inside.

    Args:
        target: The map.
        points: Points of the other map.
        T: Pose (4, 4) of the other map in this one.
    """
    voxel = target.grid.voxel_size
    # Divided in float64, so that float32 rounds once.
    turn = (T[:3, :3].astype(np.float64) / voxel).astype(np.float32)
    shift = ((T[:3, 3].astype(np.float64) - target.grid.origin) / voxel).astype(np.float32)
    turned = turned_on_host(turn, np.ascontiguousarray(points.T))
    places = (np.add(place, shift[axis], out=place) for axis, place in enumerate(turned))
    return cells_on_host(places, target.grid.shape, np.asarray(target.table))


def pieces_of(index: Int[np.ndarray, "n 3"], *, most: int = 1 << 24) -> Int[np.ndarray, "n"]:
    """Number of the piece that each of some voxels belongs to; they hang together across edges and corners, too.

    Args:
        index: Different voxels; slanted surfaces are steps of them, which share no more than edges and corners.
        most: Voxels of a box around all of them that is labelled as a whole.
    """
    # The box around the conflicts alone is labelled, not the whole map.
    index = index - index.min(axis=0)
    shape = index.max(axis=0) + 1
    if shape.astype(np.float64).prod() <= most:
        block = np.zeros(shape, bool)
        block[tuple(index.T)] = True
        labels = np.empty(block.shape, np.int32)
        ndimage.label(block, np.ones((3, 3, 3), int), output=labels)
        return labels[tuple(index.T)]
    # Centres of neighbours across a corner are the root of 3 apart, those of the next voxels 2.
    pairs = KDTree(index).query_pairs(1.9, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(index), len(index)))
    return connected_components(graph, directed=False)[1]
