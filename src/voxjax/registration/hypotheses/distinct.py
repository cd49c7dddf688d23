"""The few of many poses or rotations that stand for all that are near them."""

import numpy as np
from jaxtyping import Float, Int64


def least_trace(degrees: float) -> float:
    """Trace of `R_1^T @ R_2` above which two rotations differ by less than an angle [deg]."""
    # This is the trace of a rotation by the angle; comparing traces takes no arc cosine for each pair of rows.
    return 1.0 + 2.0 * float(np.cos(np.radians(degrees)))


def distinct_rows(
    rotations: Float[np.ndarray, "k 3 3"],
    places: Float[np.ndarray, "k 3"] | None = None,
    *,
    scores: Float[np.ndarray, "k"] | None = None,
    degrees: float,
    metres: float = np.inf,
    max_count: int | None = None,
) -> Int64[np.ndarray, "kept"]:
    """Rows that are near to no better row that is kept, best first.

    Rows are near to each other if the angle between their rotations and the distance of their places are both below
    their bounds.

    Args:
        rotations: Rotation of each row.
        places: Where each row puts a point that matters [m]; None if only rotations count.
        scores: Larger is better; equal ones in the order given. None takes rows in the order given.
        degrees: Angle below which rotations are near [deg].
        metres: Distance below which places are near [m].
        max_count: Rows kept at most; None for all.
    """
    kept: list[int] = []
    bound = least_trace(degrees)
    # The sort is stable, so that equal scores keep their order and equal inputs keep the same rows.
    order = np.arange(len(rotations)) if scores is None else np.argsort(-scores, kind="stable")
    # Rows are compared, best first, with kept ones alone: chains of near rows do not make far ones alike.
    for row in order:
        if kept:
            is_near = np.einsum("kij,ij->k", rotations[kept], rotations[row]) > bound
            if places is not None:
                is_near &= np.linalg.norm(places[kept] - places[row], axis=1) < metres
            if is_near.any():
                continue
        kept.append(int(row))
        if len(kept) == max_count:
            break
    return np.asarray(kept, dtype=np.int64)


def distinct_poses(
    poses: Float[np.ndarray, "k 4 4"],
    point: Float[np.ndarray, "3"],
    *,
    scores: Float[np.ndarray, "k"] | None = None,
    metres: float,
    degrees: float,
    max_count: int | None = None,
) -> Int64[np.ndarray, "kept"]:
    """Rows of the best poses that differ in where they put a point, or in rotation; best first.

    Args:
        poses: `T_a_b`.
        point: A point of b, such as its centroid [m].
        scores: Larger is better; equal ones in the order given. None takes poses in the order given.
        metres: Distance below which images of the point are near [m].
        degrees: Angle below which rotations are near [deg].
        max_count: Rows kept at most; None for all.
    """
    rotations = poses[:, :3, :3]
    places = rotations @ point + poses[:, :3, 3]
    return distinct_rows(
        rotations, places, scores=scores, degrees=degrees, metres=metres, max_count=max_count
    )
