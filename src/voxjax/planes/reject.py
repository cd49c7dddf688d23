"""Rejection of corners that are not on three planes: equation (3)."""

from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32
from scipy.spatial import KDTree

from .._runtime.buckets import pad_rows, wide_bucket_size
from .._types import Array


@jax.jit
def nearest_three_planes(
    points: Float32[Array, "n 3"],
    normals: Float32[Array, "n k 3"],
    offsets: Float32[Array, "n k"],
    mask: Bool[Array, "n k"],
    max_distance: Float32[Array, ""],
    min_triple_product: Float32[Array, ""],
) -> tuple[Bool[Array, "n"], Int32[Array, "n 3"], Float32[Array, "n"]]:
    """Distances of points from their nearest three planes that are not nearly parallel: equation (3).

    Args:
        points: Corners.
        normals: Unit normals (A, B, C) of k planes for each point.
        offsets: n . p of these planes (-D of the paper).
        mask: Planes that count for each point.
        max_distance: The threshold epsilon, in the unit of the points.
        min_triple_product: Three planes are nearly parallel if the triple product of their normals is
            smaller.

    Returns:
        Whether all three distances are below the threshold; the columns of the three planes, and the largest
        of the three distances (infinite where there are no three such planes).
    """
    triples = jnp.asarray(list(combinations(range(normals.shape[1]), 3)), jnp.int32)
    distance = jnp.abs(jnp.sum(normals * points[:, None, :], axis=-1, dtype=jnp.float32) - offsets)
    # A plane that does not count is infinitely far, so that no three with it is ever the nearest.
    distance = jnp.where(mask, distance, jnp.inf)
    a, b, c = (normals[:, triples[:, i]] for i in range(3))
    product = jnp.abs(jnp.sum(a * jnp.cross(b, c), axis=-1, dtype=jnp.float32))
    three = distance[:, triples]
    # The nearest three: the smallest largest distance, then the smallest sum.
    largest = jnp.where(product >= min_triple_product, jnp.max(three, axis=-1), jnp.inf)
    # The sum only decides between triples whose largest distances agree but for a thousandth of it.
    order = largest + 1e-3 * jnp.sum(three, axis=-1, dtype=jnp.float32)
    best = jnp.argmin(jnp.where(jnp.isfinite(order), order, jnp.inf), axis=1)
    worst = jnp.take_along_axis(largest, best[:, None], axis=1)[:, 0]
    return worst < max_distance, triples[best], worst


def reject_corners(
    points: Float32[np.ndarray, "n 3"],
    plane_normals: Float32[np.ndarray, "k 3"],
    plane_offsets: Float32[np.ndarray, "k"],
    support: Float32[np.ndarray, "m 3"],
    labels: Int32[np.ndarray, "m"],
    *,
    max_distance: float,
    support_radius: float,
    min_triple_product: float = 0.4,
) -> tuple[Bool[np.ndarray, "n"], Int32[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """Keep the corners that lie on three planes: equation (3).

    A plane is a candidate for a corner only if a voxel of its segment lies within `support_radius`: every
    point of a building is near three planes that go on for ever.

    Args:
        points: Initial corners [m].
        plane_normals: Unit normals of the planes.
        plane_offsets: n . p of the planes [m].
        support: Points of the segments [m].
        labels: Plane of each of these points, -1 for none.
        max_distance: The threshold epsilon [m].
        support_radius: Largest distance of a voxel of a plane's segment from the corner [m].
        min_triple_product: Planes whose normals have a smaller triple product are nearly parallel.

    Returns:
        Which corners are kept, the rows of their three planes (-1 where not kept), and the largest distance
        [m].
    """
    n = len(points)
    keep, rows, worst = np.zeros(n, bool), np.full((n, 3), -1, np.int32), np.full(n, np.inf, np.float32)
    used = labels >= 0
    if n == 0 or not used.any():
        return keep, rows, worst
    beside = _planes_beside(points, plane_normals, plane_offsets, support[used], labels[used], support_radius)
    # Relative to the middle: float32 offsets of points far from the origin lose digits.
    middle = points.mean(axis=0, dtype=np.float64)
    local = (points - middle).astype(np.float32)
    offsets = (plane_offsets - plane_normals.astype(np.float64) @ middle).astype(np.float32)
    size = wide_bucket_size(n, 256)
    padded = pad_rows(beside, size, fill=-1)
    # A column of -1 would read the last plane; it reads the first instead, which the mask leaves out.
    column = np.maximum(padded, 0)
    good, chosen, far = nearest_three_planes(
        pad_rows(local, size),
        plane_normals[column],
        offsets[column],
        padded >= 0,
        np.float32(max_distance),
        np.float32(min_triple_product),
    )
    keep, worst = np.asarray(good)[:n], np.asarray(far)[:n]
    rows[keep] = np.take_along_axis(beside, np.asarray(chosen)[:n], axis=1)[keep]
    return keep, rows, worst


def _planes_beside(points, normals, offsets, support, labels, radius):
    """The nearest planes, by equation (3), with support beside each point: int32 (n, 6), -1 for none."""
    # The nearest three of these that are not nearly parallel are sought on the device, in all threes of them at once:
    # six planes have 20.
    num_candidates = 6
    near = KDTree(support).query_ball_point(points, radius, return_sorted=False)
    row = np.repeat(np.arange(len(points)), [len(hits) for hits in near])
    if row.size == 0:
        return np.full((len(points), num_candidates), -1, np.int32)
    label = labels[np.concatenate([np.asarray(hits, np.int64) for hits in near])]
    # A plane has many voxels beside a corner, and is one candidate.
    key = np.unique(row * (int(labels.max()) + 1) + label)
    row, label = np.divmod(key, int(labels.max()) + 1)
    distance = np.abs(np.einsum("ij,ij->i", points[row].astype(np.float64), normals[label]) - offsets[label])
    order = np.lexsort((label, distance, row))
    row, label = row[order], label[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    found = np.full((len(points), num_candidates), -1, np.int32)
    wanted = rank < num_candidates
    found[row[wanted], rank[wanted]] = label[wanted]
    return found
