"""Plain Python twins of the matching stage, from the definitions; import nothing of the library."""

import itertools
import math

import numpy as np


def consistency(points_a, points_b, pairs, tolerance):
    """Equation (4) and one-to-one, pair by pair."""
    size = len(pairs)
    adjacency = np.zeros((size, size), bool)
    for p, q in itertools.permutations(range(size), 2):
        (i, j), (m, n) = pairs[p], pairs[q]
        if i == m or j == n:
            continue
        gap = math.dist(points_a[i], points_a[m]) - math.dist(points_b[j], points_b[n])
        adjacency[p, q] = abs(gap) < tolerance
    return adjacency


def distance_gaps(points_a, points_b, pairs):
    """| ||a_i - a_m|| - ||b_j - b_n|| | of all pairs of associations, float64."""
    a = np.asarray(points_a, np.float64)[[i for i, _ in pairs]]
    b = np.asarray(points_b, np.float64)[[j for _, j in pairs]]
    lengths = [np.linalg.norm(p[:, None] - p[None, :], axis=-1) for p in (a, b)]
    return np.abs(lengths[0] - lengths[1])


def angle_between(u, v):
    """Angle of two vectors [rad], stable for small and large ones."""
    return math.atan2(np.linalg.norm(np.cross(u, v)), float(np.dot(u, v)))


def rotation_angle(rotation):
    """Angle of a rotation matrix [rad]."""
    skew = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    return math.atan2(np.linalg.norm(skew), np.trace(rotation) - 1.0)


def is_clique(adjacency, members):
    """Whether all members are joined."""
    return all(adjacency[i, j] for i, j in itertools.combinations(members, 2))


def largest_common_subgraph(points_a, points_b, tolerance):
    """Size by trying all injective partial maps of a into b; only for a handful of points."""
    best = 0

    def extend(row, matches):
        nonlocal best
        best = max(best, len(matches))
        if row == len(points_a):
            return
        extend(row + 1, matches)
        for j in range(len(points_b)):
            if all(
                j != n
                and abs(math.dist(points_a[row], points_a[m]) - math.dist(points_b[j], points_b[n]))
                < tolerance
                for m, n in matches
            ):
                extend(row + 1, [*matches, (row, j)])

    extend(0, [])
    return best


def horn_alignment(points_a, points_b, weights):
    """Best rigid transform by the quaternion eigenvector method, float64: another way than by singular values."""
    a, b, w = (np.asarray(x, np.float64) for x in (points_a, points_b, weights))
    w = w / w.sum()
    mean_a, mean_b = w @ a, w @ b
    s = (b - mean_b).T @ ((a - mean_a) * w[:, None])
    trace = np.trace(s)
    delta = np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])
    n = np.empty((4, 4))
    n[0, 0] = trace
    n[0, 1:] = n[1:, 0] = delta
    n[1:, 1:] = s + s.T - trace * np.eye(3)
    q0, x, y, z = np.linalg.eigh(n)[1][:, -1]
    rotation = np.array(
        [
            [q0**2 + x**2 - y**2 - z**2, 2 * (x * y - q0 * z), 2 * (x * z + q0 * y)],
            [2 * (x * y + q0 * z), q0**2 - x**2 + y**2 - z**2, 2 * (y * z - q0 * x)],
            [2 * (x * z - q0 * y), 2 * (y * z + q0 * x), q0**2 - x**2 - y**2 + z**2],
        ]
    )
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = mean_a - rotation @ mean_b
    return T


def fused_voxels(states_a, origin_a, voxel_size, points_b, T):
    """Voxels of b that land in occupied voxels of a, one by one."""
    count = 0
    for p in points_b:
        q = T[:3, :3] @ np.asarray(p, np.float64) + T[:3, 3]
        cell = tuple(math.floor(c) for c in (q - origin_a) / voxel_size)
        inside = all(0 <= c < n for c, n in zip(cell, states_a.shape, strict=True))
        count += bool(inside and states_a[cell] == 2)
    return count
