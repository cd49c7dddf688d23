"""Chamfers: narrow segments that noise and drift lay across the edge of two faces, and that are no faces.

An edge that scans blur is rounded over three to five voxels, and the window of the normals is as wide. Where the
rounded strip is straight it grows into a plane between the two faces, at any angle; with floor and ceiling it would
give corners some voxels beside the true ones.
"""

import numpy as np
from jaxtyping import Int, Int32

from .consolidate import near_segments
from .grow import keep_large
from .segments import SegmentPlanes, plane_of_segments
from .surface import Surface


def drop_chamfers(
    surface: Surface, labels: Int32[np.ndarray, "n"], *, reach: float, max_beyond: float = 0.1
) -> Int32[np.ndarray, "n"]:
    """Take the label from segments that lie along the edge where two other segments meet.

    A segment is a chamfer if its normal leads between the normals of two neighbours and all but a few of its elements
    lie within `reach` of the line where these two planes meet. A real slanted face of that width is lost with them:
    no map tells the two apart.

    Args:
        surface: Surface elements.
        labels: Segment of each element, -1 for none.
        reach: Largest distance of a chamfer's elements from the edge [voxel].
        max_beyond: Share of the elements that may be farther away.
    """
    num = int(labels.max(initial=-1)) + 1
    # A chamfer takes three segments: itself, and the two faces whose edge it lies along.
    if num < 3:
        return labels
    points = surface.index.astype(np.float64)
    planes = plane_of_segments(points, surface.normal, labels, num)
    # A strip of width w has the variance w^2 / 12 across it.
    width = np.sqrt(12.0 * np.maximum(np.linalg.eigvalsh(planes.covariance)[:, 1], 0.0))
    first, second = near_segments(points, labels, num, reach)
    triples = _edges_beside(planes, first, second, np.flatnonzero(width < 2.0 * reach))
    if not len(triples):
        return labels
    is_chamfer = np.zeros(num, bool)
    is_chamfer[triples[_share_beyond(points, labels, planes, triples, reach) <= max_beyond, 0]] = True
    return keep_large(np.where((labels >= 0) & ~is_chamfer[labels], labels, -1).astype(np.int32), 1)


def _edges_beside(
    planes: SegmentPlanes, first: np.ndarray, second: np.ndarray, narrow: np.ndarray
) -> Int[np.ndarray, "m 3"]:
    """Triples of a narrow segment and two neighbours between whose normals its own leads."""
    # Largest cosine between a chamfer's normal and the edge (20 degrees off the right angle).
    max_along_edge = 0.35
    # Faces that make an edge differ by 20 degrees at least; chamfers of flatter edges do no harm.
    max_faces_cosine = 0.94
    found = []
    for segment in narrow:
        beside = second[first == segment]
        i, j = np.triu_indices(len(beside), 1)
        found.append(np.stack([np.full(len(i), segment), beside[i], beside[j]], axis=1))
    triples = np.concatenate(found) if found else np.zeros((0, 3), np.int64)
    own, a, b = (planes.normal[triples[:, k]] for k in range(3))
    cosine = np.einsum("ij,ij->i", a, b)
    along = np.abs(np.einsum("ij,ij->i", own, np.cross(a, b))) / np.sqrt(np.maximum(1.0 - cosine**2, 1e-12))
    # Coordinates of the normal along the two others, but for a positive factor.
    to_a, to_b = np.einsum("ij,ij->i", own, a), np.einsum("ij,ij->i", own, b)
    is_between = (to_a > cosine * to_b) & (to_b > cosine * to_a)
    return triples[is_between & (along < max_along_edge) & (np.abs(cosine) < max_faces_cosine)]


def _share_beyond(
    points: np.ndarray, labels: np.ndarray, planes: SegmentPlanes, triples: np.ndarray, reach: float
) -> np.ndarray:
    """Share of the elements of each triple's first segment farther than `reach` from the edge of the two others."""
    own, a, b = triples.T
    edge = np.cross(planes.normal[a], planes.normal[b])
    edge /= np.linalg.norm(edge, axis=1, keepdims=True)
    rows = np.stack([planes.normal[a], planes.normal[b], edge], axis=1)
    # Relative to the segment's middle: the point of the edge beside it.
    to_planes = [
        np.einsum("ij,ij->i", planes.normal[k], planes.centroid[k] - planes.centroid[own]) for k in (a, b)
    ]
    # Three planes meet in this point: those of the two faces, and the one across the edge through the segment's
    # middle.
    place = np.linalg.solve(rows, np.stack([*to_planes, np.zeros(len(own))], axis=1)[..., None])[..., 0]
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(len(planes.count) + 1))
    share = np.empty(len(triples))
    for t, segment in enumerate(own):
        # The distance from the edge is the length of what a cross product with its unit direction leaves.
        local = points[order[bounds[segment] : bounds[segment + 1]]] - planes.centroid[segment] - place[t]
        share[t] = np.mean(np.linalg.norm(np.cross(local, edge[t]), axis=1) > reach)
    return share
