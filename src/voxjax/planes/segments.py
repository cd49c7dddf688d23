"""Moments of labelled elements: the plane of each segment in closed form, on the host."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32


class SegmentPlanes(NamedTuple):
    """Least-squares planes of segments, float64, in the unit of the points.

    Attributes:
        normal: (k, 3) unit, on the side of the elements' mean normal.
        centroid: (k, 3).
        covariance: (k, 3, 3) of the points about the centroid.
        count: (k,) number of elements.
        rms: (k,) root mean square distance of the elements from the plane.
    """

    normal: np.ndarray
    centroid: np.ndarray
    covariance: np.ndarray
    count: np.ndarray
    rms: np.ndarray

    def distance(self, points: np.ndarray, labels: np.ndarray) -> np.ndarray:
        """Signed distance of each point from the plane it is paired with."""
        return np.einsum("ij,ij->i", points - self.centroid[labels], self.normal[labels])


def plane_of_segments(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    labels: Int32[np.ndarray, "n"],
    num: int,
) -> SegmentPlanes:
    """Fit one plane to the points of each label in [0, num); points with other labels are left out.

    Segments with fewer than three points get a plane through their centroid with their mean normal.
    """
    used = np.flatnonzero(labels >= 0)
    # Coordinates apart, each contiguous: three times as fast as rows of three.
    x, label = [points[used, a].astype(np.float64) for a in range(3)], labels[used]
    count = np.bincount(label, minlength=num).astype(np.float64)
    # Labels without an element have sums of 0: divided by 1, they give 0 where 0 / 0 would be NaN.
    count_safe = np.maximum(count, 1.0)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(label, weights=values, minlength=num) / count_safe

    centroid = np.stack([mean(coordinate) for coordinate in x], axis=1)
    # Squares are of coordinates about the centroid: those of places far off would leave few digits of their
    # difference.
    local = [x[a] - centroid[:, a][label] for a in range(3)]
    covariance = np.empty((num, 3, 3))
    for a in range(3):
        for b in range(a, 3):
            covariance[:, a, b] = covariance[:, b, a] = mean(local[a] * local[b])
    values, vectors = np.linalg.eigh(covariance)
    # The sign of an eigenvector means nothing; the elements know on which side free space is.
    toward = np.stack([mean(normals[used, a].astype(np.float64)) for a in range(3)], axis=1)
    length = np.linalg.norm(toward, axis=1, keepdims=True)
    fallback = np.where(length > 0, toward / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
    normal = np.where((count >= 3)[:, None], vectors[:, :, 0], fallback)
    normal = np.where((np.einsum("ij,ij->i", normal, toward) < 0)[:, None], -normal, normal)
    return SegmentPlanes(normal, centroid, covariance, count, np.sqrt(np.maximum(values[:, 0], 0.0)))
