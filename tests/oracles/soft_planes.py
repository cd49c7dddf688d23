"""Planes of softly occupied voxels from their definition, one voxel after the other, in float64."""

import numpy as np


def neighbours(index, row, size):
    """Rows of the listed voxels within size / 2 of one of them, and their offsets from it."""
    offset = index.astype(np.float64) - index[row]
    rows = np.flatnonzero(4 * (offset**2).sum(axis=1) <= size * size)
    return rows, offset[rows]


def soft_plane(occupancy, index, row, size):
    """Weight, weighted mean offset, and covariance of a window."""
    rows, offset = neighbours(index, row, size)
    w = np.asarray(occupancy, np.float64)[rows]
    weight = w.sum()
    if weight == 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mean = (w[:, None] * offset).sum(axis=0) / weight
    centred = offset - mean
    return weight, mean, (w[:, None, None] * centred[:, :, None] * centred[:, None, :]).sum(axis=0) / weight


def planarity(covariance, weight):
    """1 on a plane, 0 from half the curvature of a ball on; rises smoothly between weights of 9 and 10."""
    values = np.linalg.eigvalsh(covariance)
    curvature = max(values[0], 0.0) / values.sum() if values.sum() > 0 else 0.0
    enough = np.clip(weight - 9, 0, 1)
    return max(1 - 6 * curvature, 0.0) * enough**2 * (3 - 2 * enough)


def ten_sums(weights, index, row, size):
    """Sums of 1, x, y, z, xx, yy, zz, xy, xz, yz."""
    rows, offset = neighbours(index, row, size)
    x, y, z = offset.T
    terms = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])
    return terms @ np.asarray(weights, np.float64)[rows]
