"""How precisely a corner is known: from the fits of its three planes, and the grid."""

import numpy as np
from jaxtyping import Float32

from ..planes.extract import PlaneMap
from ..planes.segments import plane_of_segments
from ..planes.triples import PlaneTriples


def corner_covariance(plane_map: PlaneMap, triples: PlaneTriples) -> Float32[np.ndarray, "m 3 3"]:
    """Covariance of the points where three planes meet [m^2].

    Each plane is off, at the corner, by the errors of its offset and of its two tilts; these grow with the distance
    of the corner from the middle of the plane's support, measured in widths of the support. What the three planes
    are off by moves the corner by the inverse of their normals.

    Args:
        plane_map: The planes with their support.
        triples: Three planes and the point where they meet, for each corner.
    """
    # Surface elements that share one error: what noise and drift do to a wall is alike over some four voxels each way.
    elements_a_sample = 16.0
    # Standard deviation [voxel] that no averaging removes: rounding to the grid (0.29 for a face that lies along it,
    # less for others) and drift of the mapper between the scans that saw a face.
    systematic = 0.18
    voxel = plane_map.voxel_size
    num = int(plane_map.planes.num_found)
    if not len(triples.planes):
        return np.zeros((0, 3, 3), np.float32)
    support = plane_of_segments(
        plane_map.points.astype(np.float64) / voxel, plane_map.normals, plane_map.labels, num
    )
    spread, axes = np.linalg.eigh(support.covariance)
    samples = np.maximum(support.count / elements_a_sample, 1.0)
    # The two directions in the plane; a voxel's own width keeps thin strips from being lines.
    width = spread[:, 1:] + 1.0 / 12.0
    rows = triples.planes
    away = triples.position[:, None, :] / voxel - support.centroid[rows]
    # What a tilt is off by grows with the distance from the middle, in widths of the support, as for a
    # regression line.
    leverage = np.einsum("mki,mkij->mkj", away, axes[rows][..., 1:]) ** 2 / width[rows]
    noise = (support.rms**2 + 1.0 / 12.0)[rows] / samples[rows] * (1.0 + leverage.sum(axis=-1))
    variance = noise + systematic**2
    # Triples with flat angles were left out before, so that the normals have an inverse.
    inverse = np.linalg.inv(np.asarray(plane_map.planes.normal, np.float64)[rows])
    covariance = np.einsum("mik,mk,mjk->mij", inverse, variance, inverse)
    return (covariance * voxel**2).astype(np.float32)
