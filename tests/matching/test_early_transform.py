"""The early transform: matches give a transform, and that the rest of the scheme."""

import numpy as np
from scipy.spatial.transform import Rotation

from oracles.motions import moved, random_pose
from voxjax.matching.early_transform import close_corners, kabsch


def test_close_corners_carry_b_into_a_and_keep_the_matches():
    rng = np.random.default_rng(5)
    a, b, T = rng.uniform(0, 10, (12, 3)), rng.uniform(0, 10, (12, 3)), random_pose(rng)
    b[:9] = moved(np.linalg.inv(T), a[:9])
    matches = np.array([[k, k] for k in range(5)], np.int32)
    extend = close_corners(
        a.astype(np.float32), b.astype(np.float32), np.ones(12, bool), np.ones(12, bool), 0.1
    )
    scheme = extend(matches)
    assert {tuple(p) for p in scheme.tolist()} >= {(k, k) for k in range(9)}
    gaps = np.linalg.norm(moved(T, b[scheme[:, 1]]) - a[scheme[:, 0]], axis=1)
    assert gaps.max() < 0.11


def test_host_alignment_equals_scipy():
    rng = np.random.default_rng(4)
    b = rng.normal(size=(7, 3))
    a = b @ random_pose(rng)[:3, :3].T + rng.normal(0, 0.1, (7, 3))
    expected = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0]
    np.testing.assert_allclose(kabsch(a, b)[:3, :3], expected.as_matrix(), atol=1e-9)
