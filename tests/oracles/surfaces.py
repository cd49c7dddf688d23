"""Normals, curvature and region growing from their definitions, one voxel after the other."""

from collections import deque

import numpy as np


def ball(occupied_set, centre, size):
    """Occupied voxels within size / 2 of the centre."""
    half = size // 2
    found = []
    for dx in range(-half, half + 1):
        for dy in range(-half, half + 1):
            for dz in range(-half, half + 1):
                place = (centre[0] + dx, centre[1] + dy, centre[2] + dz)
                if 4 * (dx * dx + dy * dy + dz * dz) <= size * size and place in occupied_set:
                    found.append(place)
    return np.asarray(found, np.float64)


def normal_and_curvature(states, centre, size):
    """Smallest principal direction (sign free), curvature and number of voxels in the ball."""
    occupied = {tuple(int(c) for c in place) for place in np.argwhere(states == 2)}
    points = ball(occupied, tuple(int(c) for c in centre), size)
    covariance = np.cov(points.T, bias=True) if len(points) > 1 else np.zeros((3, 3))
    values, vectors = np.linalg.eigh(covariance)
    total = values.sum()
    return vectors[:, 0], (values[0] / total if total > 0 else 0.0), len(points), values


def grow_regions(neighbours, normals, curvature, max_angle, max_curvature):
    """Sequential region growing: seeds by rising curvature; neighbours are compared with the current seed.

    Regions whose first seed is above the curvature threshold are not grown.
    """
    labels = np.full(len(curvature), -1)
    min_cosine, region = np.cos(np.radians(max_angle)), 0
    for start in np.argsort(curvature, kind="stable"):
        if labels[start] >= 0 or curvature[start] >= max_curvature:
            continue
        labels[start] = region
        seeds = deque([start])
        while seeds:
            seed = seeds.popleft()
            for other in neighbours[seed]:
                if labels[other] < 0 and normals[seed] @ normals[other] > min_cosine:
                    labels[other] = region
                    if curvature[other] < max_curvature:
                        seeds.append(other)
        region += 1
    return labels


def plane_by_svd(points):
    """Least-squares plane: unit normal (sign free), centroid."""
    centroid = points.mean(axis=0)
    return np.linalg.svd(points - centroid)[2][2], centroid


def nearest_three(point, normals, offsets, min_triple_product):
    """Smallest possible largest distance to three planes that are not nearly parallel; equation (3)."""
    distance = np.abs(normals @ point - offsets)
    best = np.inf
    n = len(normals)
    for a in range(n):
        for b in range(a + 1, n):
            for c in range(b + 1, n):
                if abs(np.linalg.det(normals[[a, b, c]])) >= min_triple_product:
                    best = min(best, distance[[a, b, c]].max())
    return best
