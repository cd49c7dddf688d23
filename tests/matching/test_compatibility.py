import jax
import numpy as np

from oracles.matching import angle_between
from voxjax.matching.compatibility import distance_consistency
from voxjax.matching.consistency import pairwise_consistency


def test_normals_agree_where_the_three_angles_do():
    rng = np.random.default_rng(7)
    a, b = rng.uniform(0, 3, (2, 8, 3)).astype(np.float32)
    normals = rng.normal(size=(2, 8, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    pairs = np.stack([np.arange(8)] * 2, axis=1)
    tolerance = 0.6
    adjacency = pairwise_consistency(
        a,
        b,
        pairs,
        distance_tolerance=100.0,
        angle_tolerance=tolerance,
        normals_a=normals[0],
        normals_b=normals[1],
    )
    for i in range(8):
        for j in range(i + 1, 8):
            gaps = []
            for u, v in ((0, 1), (0, 2), (1, 2)):
                angles = []
                for points, n in ((a, normals[0]), (b, normals[1])):
                    triple = n[i], n[j], points[j] - points[i]
                    angles.append(angle_between(triple[u], triple[v]))
                gaps.append(abs(angles[0] - angles[1]))
            if abs(max(gaps) - tolerance) > 1e-4:
                assert adjacency[i, j] == (max(gaps) < tolerance)


def test_kernel_runs_under_vmap():
    rng = np.random.default_rng(9)
    a, b = rng.uniform(0, 3, (2, 4, 10, 3)).astype(np.float32)
    pairs = np.stack([np.arange(10, dtype=np.int32)] * 2, axis=1)
    batched = jax.vmap(distance_consistency, in_axes=(0, 0, None, None, None))(
        a, b, pairs, np.float32(0.3), np.float32(0.0)
    )
    for k in range(4):
        single = distance_consistency(a[k], b[k], pairs, np.float32(0.3), np.float32(0.0))
        np.testing.assert_array_equal(batched[k], single)
