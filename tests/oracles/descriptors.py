"""Point feature histograms, mutual nearest rows and agreement of matches from their definitions, by loops."""

import numpy as np


def plane_normal(points):
    """Direction of least variance and its share of the variance."""
    centred = points - points.mean(0)
    values, vectors = np.linalg.eigh(centred.T @ centred)
    return vectors[:, 0], values[0] / values.sum()


def pair_features(p, n, q, m):
    """The three angles of a pair in the frame on p, scaled to [0, 1]."""
    d = (q - p) / np.linalg.norm(q - p)
    v = np.cross(d, n)
    v = v / max(np.linalg.norm(v), 1e-6)
    w = np.cross(n, v)
    return (v @ m + 1) / 2, (n @ d + 1) / 2, np.arctan2(w @ m, n @ m) / (2 * np.pi) + 0.5


def histograms(points, normals, radius, spacing, bins):
    """Square roots of the normalised FPFH of every point."""
    n = len(points)
    near = [
        [j for j in range(n) if j != i and np.linalg.norm(points[j] - points[i]) <= radius] for i in range(n)
    ]
    simple = np.zeros((n, 3, bins))
    for i in range(n):
        for j in near[i]:
            for f, x in enumerate(pair_features(points[i], normals[i], points[j], normals[j])):
                simple[i, f, min(max(int(x * bins), 0), bins - 1)] += 1 / len(near[i])
    result = np.zeros((n, 3, bins))
    for i in range(n):
        for j in near[i]:
            result[i] += simple[j] * spacing / max(np.linalg.norm(points[j] - points[i]), 0.5 * spacing)
        if near[i]:
            result[i] /= result[i].sum(1, keepdims=True)
    return np.sqrt(result).reshape(n, -1)


def mutual_pairs(a, b, mask_a, mask_b):
    """Pairs (i, j) that are each other's nearest among the rows that take part."""
    rows_a, rows_b = np.flatnonzero(mask_a), np.flatnonzero(mask_b)
    nearest_b = {i: min(rows_b, key=lambda j: (((a[i] - b[j]) ** 2).sum(), j)) for i in rows_a}
    nearest_a = {j: min(rows_a, key=lambda i: (((a[i] - b[j]) ** 2).sum(), i)) for j in rows_b}
    return sorted((i, j) for i, j in nearest_b.items() if nearest_a[j] == i)


def agree(match, other, tolerance, cosine):
    """Whether two matches (point, normal, point, normal) may both be right."""
    lengths, angles = [], []
    for side in (0, 2):
        offset = other[side] - match[side]
        lengths.append(np.linalg.norm(offset))
        d = offset / max(lengths[-1], 1e-6)
        angles.append([match[side + 1] @ other[side + 1], match[side + 1] @ d, other[side + 1] @ d])
    return bool(
        min(lengths) > 2 * tolerance
        and abs(lengths[0] - lengths[1]) <= tolerance
        and (np.abs(np.subtract(*angles)) <= cosine).all()
    )
