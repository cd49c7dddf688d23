"""The early transform of section IV.C: a few matches give a transform, and that gives the rest of the scheme."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from .. import rigid
from .backtracking import Extend

Align = Callable[[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]], Float[np.ndarray, "4 4"]]
"""Transform `T_a_b` of matched points (of a, of b)."""


def close_corners(
    points_a: np.ndarray,
    points_b: np.ndarray,
    mask_a: np.ndarray,
    mask_b: np.ndarray,
    distance_tolerance: float,
    align: Align | None = None,
) -> Extend:
    """The early transform as a function from a few matches to a whole scheme.

    The transform of the matches carries the corners of b into a. Each that comes nearer than the tolerance to a corner
    of a joins the matches with the nearest one, the closest first and each corner once.

    Args:
        points_a: Corners of map a, float32 (n, 3) [m].
        points_b: Corners of map b, float32 (m, 3) [m].
        mask_a: Rows of `points_a` that count.
        mask_b: Rows of `points_b` that count.
        distance_tolerance: D of equation (4) [m].
        align: How to get the transform of matched corners; None aligns them alone.
    """
    rows_a, rows_b = np.flatnonzero(mask_a), np.flatnonzero(mask_b)
    corners_a, corners_b = points_a[rows_a].astype(np.float64), points_b[rows_b].astype(np.float64)
    tree_a = KDTree(corners_a)
    solve = kabsch if align is None else align

    def extend(matches: np.ndarray) -> np.ndarray:
        # The rounding of five matches near each other turns far corners; float64 adds none of its own.
        T_a_b = np.asarray(solve(points_a[matches[:, 0]], points_b[matches[:, 1]]), np.float64)
        moved = corners_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
        distance, nearest = map(np.asarray, tree_a.query(moved, distance_upper_bound=distance_tolerance))
        scheme = {int(i): int(j) for i, j in matches}
        taken = set(scheme.values())
        # The nearest come first and a corner is taken once: of two that want the same one, the closer gets it.
        # Distances beyond the tolerance are infinite and come last.
        for k in np.argsort(distance, kind="stable"):
            if not np.isfinite(distance[k]):
                break
            i, j = int(rows_a[nearest[k]]), int(rows_b[k])
            if i not in scheme and j not in taken:
                scheme[i] = j
                taken.add(j)
        return np.asarray(sorted(scheme.items()), np.int32)

    return extend


def kabsch(points_a: np.ndarray, points_b: np.ndarray) -> np.ndarray:
    """`T_a_b` of matched points on the host, float64 (4, 4): thousands of tiny problems inside a search."""
    points_a, points_b = points_a.astype(np.float64), points_b.astype(np.float64)
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    T_a_b = np.eye(4)
    T_a_b[:3, :3] = rigid.nearest_rotation((points_a - mean_a).T @ (points_b - mean_b))
    # The best translation carries the one centroid onto the other, whatever the rotation is.
    T_a_b[:3, 3] = mean_a - T_a_b[:3, :3] @ mean_b
    return T_a_b
