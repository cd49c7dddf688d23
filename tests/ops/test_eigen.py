import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.ops.eigen import symmetric_eigen


def _matrices(seed, values):
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(len(values), 3, 3)))[0]
    return np.einsum("nij,nj,nkj->nik", turns, values, turns).astype(np.float32)


def _check(matrix, tolerance=3e-3):
    values, rows = (np.asarray(a) for a in symmetric_eigen(matrix))
    scale = np.abs(matrix).max(axis=(1, 2))
    expected = np.linalg.eigvalsh(matrix.astype(np.float64))
    assert (np.abs(values - expected) <= tolerance * scale[:, None]).all()
    identity = np.broadcast_to(np.eye(3), matrix.shape)
    np.testing.assert_allclose(rows @ np.swapaxes(rows, 1, 2), identity, atol=1e-4)
    residual = np.einsum("nij,nkj->nki", matrix, rows) - values[:, :, None] * rows
    assert (np.abs(residual).max(axis=(1, 2)) <= 2 * tolerance * scale).all()


def test_values_and_vectors_of_random_matrices():
    rng = np.random.default_rng(0)
    _check(_matrices(1, rng.normal(size=(200, 3))))


def test_matrices_of_planes_lines_and_points():
    values = np.asarray(
        [[0, 1, 1], [0, 1, 5], [0, 0, 2], [1, 1, 1], [0, 0, 0], [1e-6, 1, 1.0001]], np.float64
    )
    _check(_matrices(2, values))


def test_normals_of_planes_are_good_to_a_twentieth_of_a_degree():
    rng = np.random.default_rng(3)
    values = np.stack([rng.uniform(0, 0.05, 300), rng.uniform(1, 2, 300), rng.uniform(2, 4, 300)], axis=1)
    matrix = _matrices(4, values)
    ours = np.asarray(symmetric_eigen(matrix)[1])[:, 0]
    truth = np.linalg.eigh(matrix.astype(np.float64))[1][:, :, 0]
    sine = np.linalg.norm(np.cross(ours, truth), axis=1)
    assert np.degrees(sine.max()) < 0.05


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-6, 1e6), st.integers(0, 2**31))
def test_the_unit_does_not_matter(scale, seed):
    _check(_matrices(seed, np.asarray([[0.1, 1.0, 3.0]])) * np.float32(scale))
