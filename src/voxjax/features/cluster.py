"""Clustering of corners, so that there are only a few at the same place (section III)."""

import numpy as np
from jaxtyping import Float, Int32
from scipy.sparse import coo_matrix
from scipy.spatial import KDTree


def cluster_corners(
    position: Float[np.ndarray, "n 3"], quality: Float[np.ndarray, "n"], *, radius: float
) -> tuple[Int32[np.ndarray, "n"], Int32[np.ndarray, "k"]]:
    """Cluster corners and choose one of each cluster (section III).

    Best first: the best corner takes all within `radius` of it, then the best of the rest, and so on. A
    cluster is therefore never wider than twice the radius, and a physical corner keeps one corner or a few.

    Args:
        position: Positions.
        quality: Higher is better; ties go to the earlier corner.
        radius: Radius in the unit of the positions.

    Returns:
        The cluster of each corner (n,) and the chosen member of each cluster (k,), both int32, best first.
    """
    n = len(position)
    if n == 0:
        return np.zeros(0, np.int32), np.zeros(0, np.int32)
    near = KDTree(position).query_ball_point(position, radius)
    return _take_best_first(near, quality)


def _take_best_first(near, quality: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greedy cover: each best remaining item takes its remaining neighbours."""
    cluster = np.full(len(quality), -1, np.int32)
    chosen = []
    for best in np.argsort(-quality, kind="stable"):
        if cluster[best] < 0:
            taken = np.asarray(near[best], np.int64)
            cluster[taken[cluster[taken] < 0]] = len(chosen)
            # A corner always takes itself, also where lists of neighbours leave it out.
            cluster[best] = len(chosen)
            chosen.append(best)
    return cluster, np.asarray(chosen, np.int32)


def suppress_duplicates(
    position: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3 3"],
    kind: Int32[np.ndarray, "n"],
    weight: Float[np.ndarray, "n"],
    *,
    radius: float,
    min_cosine: float = 0.94,
) -> Int32[np.ndarray, "k"]:
    """Keep the heaviest of corners that are the same but for noise: near, of one kind, with the same normals.

    The four corners of four rooms that meet at one point differ in their normals and are all kept.

    Args:
        position: Positions.
        normals: Unit rows; compared as sets.
        kind: Corners of different kinds are different.
        weight: Higher is better.
        radius: Radius in the unit of the positions.
        min_cosine: Normals agree from this cosine on.

    Returns:
        Rows to keep, heaviest first.
    """
    if len(position) == 0:
        return np.zeros(0, np.int32)
    pairs = KDTree(position).query_pairs(radius, output_type="ndarray")
    i, j = pairs.T
    cosine = np.einsum("mac,mbc->mab", normals[i], normals[j])
    # The order of the normals differs with the plane that came first, so that they are compared as sets, both ways.
    same = (cosine.max(axis=2) > min_cosine).all(axis=1) & (cosine.max(axis=1) > min_cosine).all(axis=1)
    same &= kind[i] == kind[j]
    i, j = i[same], j[same]
    n = len(position)
    near = coo_matrix((np.ones(2 * len(i), np.int8), (np.r_[i, j], np.r_[j, i])), shape=(n, n)).tolil().rows
    return _take_best_first(near, weight)[1]
