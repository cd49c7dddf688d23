"""How far a pose is from the truth."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ._types import Array


class PoseError(NamedTuple):
    """Difference of two poses.

    Attributes:
        degrees: Angle between the rotations.
        metres: Distance between the images of one point, usually the centroid of the moved map.
    """

    degrees: float
    metres: float


def pose_error(T: Float[Array, "4 4"], truth: Float[Array, "4 4"], point: Float[Array, "3"]) -> PoseError:
    """Angle between two poses, and how far apart they put a point.

    Args:
        T: Found pose.
        truth: True pose.
        point: A point in the frame that both poses map from [m].
    """
    # In float32, products of entries near 1 would hide the angles of well refined poses.
    T, truth, point = (np.asarray(x, np.float64) for x in (T, truth, point))
    relative = T[:3, :3].T @ truth[:3, :3]
    # atan2 of sine and cosine: arccos loses small angles.
    sine = np.linalg.norm(
        [relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0], relative[1, 0] - relative[0, 1]]
    )
    degrees = np.degrees(np.arctan2(sine / 2, (np.trace(relative) - 1) / 2))
    # Differences come first: images of a point far from the origin are large, and their difference is small.
    gap = (T[:3, :3] - truth[:3, :3]) @ point + T[:3, 3] - truth[:3, 3]
    return PoseError(float(degrees), float(np.linalg.norm(gap)))
