"""Points where three planes meet, and how far their supports are from them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from .consolidate import near_segments
from .extract import PlaneMap


class PlaneTriples(NamedTuple):
    """Intersections of three planes of a map.

    Attributes:
        planes: int32 (m, 3) rows of the planes, ascending.
        position: float64 (m, 3) [m].
        triple_product: float64 (m,): of the normals, signed; 1 where they are at right angles.
        distance: float64 (m, 3) [m]: from the position to the nearest support of each plane.
    """

    planes: Int[np.ndarray, "m 3"]
    position: Float[np.ndarray, "m 3"]
    triple_product: Float[np.ndarray, "m"]
    distance: Float[np.ndarray, "m 3"]


def intersect_planes(
    plane_map: PlaneMap, *, reach: float, min_triple_product: float, max_planes: int = 256
) -> PlaneTriples:
    """Intersect all triples of planes that are not nearly parallel and whose supports come near the point.

    Args:
        plane_map: Planes and their support.
        reach: Largest distance of each plane's support from the point [m].
        min_triple_product: Smallest absolute triple product of the three unit normals.
        max_planes: Only the largest planes take part.

    Returns:
        `PlaneTriples`, in order of the plane rows.
    """
    planes = plane_map.planes.trimmed()
    num = min(int(planes.num_found), max_planes)
    # Supports within the reach of one point are within twice the reach of each other.
    triples = _near_triples(plane_map, num, 2.0 * reach)
    normals = np.asarray(planes.normal, np.float64)[triples]
    crosses = np.stack([np.cross(normals[:, (i + 1) % 3], normals[:, (i + 2) % 3]) for i in range(3)], axis=1)
    product = np.einsum("ij,ij->i", normals[:, 0], crosses[:, 0])
    steep = np.abs(product) >= min_triple_product
    triples, crosses, product = triples[steep], crosses[steep], product[steep]
    # Relative to the middle of the map: offsets of planes far from the origin lose digits.
    middle = plane_map.points.mean(axis=0, dtype=np.float64) if len(plane_map.points) else np.zeros(3)
    offset = np.asarray(planes.offset, np.float64) - np.asarray(planes.normal, np.float64) @ middle
    # Cramer's rule: the point is the sum of offsets times cross products of the two other normals, over the
    # triple product.
    position = np.einsum("ij,ijk->ik", offset[triples], crosses) / product[:, None] + middle
    distance = _support_distance(plane_map, triples, position, reach)
    near = (distance <= reach).all(axis=1)
    return PlaneTriples(triples[near], position[near], product[near], distance[near])


def _near_triples(plane_map: PlaneMap, num: int, gap: float) -> np.ndarray:
    """Triples i < j < k of planes whose supports come pairwise within about `gap`."""
    labels = np.where(plane_map.labels < num, plane_map.labels, -1)
    if num < 3:
        return np.zeros((0, 3), np.int32)
    a, b = near_segments(plane_map.points.astype(np.float64), labels, num, gap)
    normals = np.asarray(plane_map.planes.normal, np.float64)[:num]
    is_near = np.zeros((num, num), bool)
    is_near[a, b] = True
    # Planes within some 25 degrees of each other fix no point well, and leaving out pairs keeps the triples few.
    is_near &= is_near.T & (np.abs(normals @ normals.T) < 0.9)
    is_near = np.triu(is_near, 1)
    return np.argwhere(is_near[:, :, None] & is_near[:, None, :] & is_near[None, :, :]).astype(np.int32)


def _support_distance(
    plane_map: PlaneMap, triples: np.ndarray, position: np.ndarray, reach: float
) -> np.ndarray:
    """Distance of each position from the elements of each of its planes; infinite beyond `reach`."""
    distance = np.full(triples.shape, np.inf)
    if triples.size == 0:
        return distance
    points, labels = _thinned_support(plane_map)
    # The support is sorted by plane: each plane's part is a slice, and so are the corners that ask about it.
    bounds = np.searchsorted(labels, np.arange(triples.max() + 2))
    order = np.argsort(triples.ravel(), kind="stable")
    wanted = np.searchsorted(triples.ravel()[order], np.arange(triples.max() + 2))
    for plane in np.unique(triples):
        rows, columns = np.divmod(order[wanted[plane] : wanted[plane + 1]], 3)
        # Each plane has a tree of its own: the nearest support of all planes would mostly be that of another one.
        tree = KDTree(points[bounds[plane] : bounds[plane + 1]])
        distance[rows, columns] = tree.query(position[rows], distance_upper_bound=reach)[0]
    return distance


def _thinned_support(plane_map: PlaneMap) -> tuple[np.ndarray, np.ndarray]:
    """One element of each plane per block of four voxels, sorted by plane."""
    used = plane_map.labels >= 0
    points, labels = plane_map.points[used].astype(np.float64), plane_map.labels[used]
    block = np.floor((points - points.min(axis=0, initial=0.0)) / (4.0 * plane_map.voxel_size)).astype(
        np.int64
    )
    block -= block.min(axis=0) if len(block) else 0  # from the map on, however far out it lies
    shape = block.max(axis=0, initial=0) + 1
    key = labels.astype(np.int64) * int(np.prod(shape)) + np.ravel_multi_index(tuple(block.T), tuple(shape))
    _, first = np.unique(key, return_index=True)
    return points[first], labels[first]
