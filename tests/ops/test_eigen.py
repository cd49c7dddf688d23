import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from compilations import QUICK
from voxjax.ops.eigen import eigen_by_columns, symmetric_eigen


def _matrices(seed, values):
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(len(values), 3, 3)))[0]
    return np.einsum("nij,nj,nkj->nik", turns, values, turns).astype(np.float32)


def _check(matrix, tolerance=3e-6):
    values, rows = (np.asarray(a) for a in symmetric_eigen(matrix))
    scale = np.abs(matrix).max(axis=(1, 2))
    expected = np.linalg.eigvalsh(matrix.astype(np.float64))
    assert (np.abs(values - expected) <= tolerance * scale[:, None]).all()
    identity = np.broadcast_to(np.eye(3), matrix.shape)
    np.testing.assert_allclose(rows @ np.swapaxes(rows, 1, 2), identity, atol=2e-6)
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


def test_matrices_and_columns_are_one_decomposition_of_any_batch():
    matrix = _matrices(3, np.random.default_rng(3).normal(size=(24, 3)))
    values, vectors = symmetric_eigen(matrix.reshape(2, 3, 4, 3, 3))
    found = eigen_by_columns(_columns(matrix))
    np.testing.assert_array_equal(np.asarray(values).reshape(24, 3), np.asarray(found.values).T)
    np.testing.assert_array_equal(
        np.asarray(vectors).reshape(24, 3, 3), np.moveaxis(np.asarray(found.vectors), -1, 0)
    )
    for one, other in zip(symmetric_eigen(matrix[0]), (values, vectors), strict=True):
        np.testing.assert_allclose(one, np.asarray(other)[0, 0, 0], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-6, 1e6), st.integers(0, 2**31))
def test_the_unit_does_not_matter(scale, seed):
    _check(_matrices(seed, np.asarray([[0.1, 1.0, 3.0]])) * np.float32(scale))


def _columns(matrix):
    """The six rows of entries that `eigen_by_columns` takes."""
    return np.stack([matrix[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])


_SPECIAL = np.asarray(
    [[0, 1, 1], [0, 1, 5], [0, 0, 2], [1, 1, 1], [0, 0, 0], [1e-6, 1, 1.0001], [-1, 0, 1], [-2, -2, 5]]
)


def test_columns_give_values_and_vectors_also_where_values_coincide():
    rng = np.random.default_rng(5)
    matrix = _matrices(
        6, np.concatenate([_SPECIAL, rng.normal(size=(200, 3)), rng.normal(size=(9, 3)) * 1e5])
    )
    found = eigen_by_columns(_columns(matrix))
    values, rows = np.asarray(found.values).T, np.moveaxis(np.asarray(found.vectors), -1, 0)
    scale = np.maximum(np.abs(matrix).max(axis=(1, 2)), 1e-30)
    expected = np.linalg.eigvalsh(matrix.astype(np.float64))
    np.testing.assert_array_less(np.abs(values - expected) / scale[:, None], 2e-6)
    np.testing.assert_allclose(
        rows @ np.swapaxes(rows, 1, 2), np.broadcast_to(np.eye(3), matrix.shape), atol=2e-6
    )
    residual = np.einsum("nij,nkj->nki", matrix, rows) - values[:, :, None] * rows
    np.testing.assert_array_less(np.abs(residual).max(axis=(1, 2)) / scale, 5e-6)


def test_columns_say_which_vectors_are_defined():
    found = eigen_by_columns(_columns(_matrices(7, _SPECIAL)))
    lone = [[1, 0, 0], [1, 1, 1], [0, 0, 1], [0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 0, 1]]
    np.testing.assert_array_equal(np.asarray(found.is_defined).T, np.asarray(lone, bool))


def test_normals_by_columns_are_good_to_a_thousandth_of_a_degree():
    rng = np.random.default_rng(3)
    values = np.stack([rng.uniform(0, 0.05, 300), rng.uniform(1, 2, 300), rng.uniform(2, 4, 300)], axis=1)
    matrix = _matrices(4, values)
    ours = np.asarray(eigen_by_columns(_columns(matrix)).vectors)[0].T
    truth = np.linalg.eigh(matrix.astype(np.float64))[1][:, :, 0]
    assert np.degrees(np.linalg.norm(np.cross(ours, truth), axis=1).max()) < 1e-3


def test_long_lists_give_what_short_ones_give():
    entries = np.tile(_columns(_matrices(12, np.random.default_rng(12).normal(size=(300, 3)))), 60)
    long, short = eigen_by_columns(entries), eigen_by_columns(entries[:, :300])
    for one, other in zip(long, short, strict=True):
        assert one.shape[-1] == 18_000
        np.testing.assert_allclose(one, np.tile(other, 60), atol=2e-6)
    by_values = jax.grad(lambda e: jnp.sum(eigen_by_columns(e).values[2], dtype=jnp.float32))
    np.testing.assert_allclose(by_values(entries), np.tile(by_values(entries[:, :300]), 60), atol=1e-4)


def _loss(entries, weights):
    found = eigen_by_columns(entries)
    turned = jnp.abs(jnp.sum(found.vectors * weights[:, :, None], axis=1))
    return jnp.sum(turned, dtype=jnp.float32) + jnp.sum(found.values**2, dtype=jnp.float32)


# For eight matrices in all tests, so that it is compiled once.
_value_and_gradient = jax.jit(jax.value_and_grad(_loss), compiler_options=QUICK)


def test_gradients_are_those_of_finite_differences():
    rng = np.random.default_rng(8)
    values = [[0.1, 1.0, 3.0], [-2.0, 0.5, 1.0]]
    entries = jnp.asarray(_columns(_matrices(9, np.tile(np.asarray(values), (4, 1)))))
    weights = jnp.asarray(rng.normal(size=(3, 3)), jnp.float32)
    _, gradient = _value_and_gradient(entries, weights)
    for _ in range(4):
        direction = jnp.asarray(rng.normal(size=entries.shape), jnp.float32)
        ends = [float(_value_and_gradient(entries + step * direction, weights)[0]) for step in (5e-3, -5e-3)]
        slope = (ends[0] - ends[1]) / 1e-2
        np.testing.assert_allclose(float(jnp.sum(gradient * direction)), slope, rtol=2e-2, atol=2e-2)


def test_gradients_are_finite_where_values_coincide():
    entries = jnp.asarray(_columns(_matrices(10, _SPECIAL)))
    exact = jnp.asarray([[1.0, 0, 2], [1.0, 0, 2], [1.0, 0, 5], [0, 0, 0], [0, 0, 0], [0, 0, 0]], jnp.float32)
    weights = jnp.asarray(np.random.default_rng(11).normal(size=(3, 3)), jnp.float32)
    for matrices in (entries, jnp.concatenate([exact, exact[:, :2]], axis=1)):
        _, gradient = _value_and_gradient(matrices, weights)
        assert np.isfinite(gradient).all()
    # Of the values alone the gradient at a multiple of the identity is exact: the trace of squares.
    # Without weights the loss is that sum.
    _, by_values = _value_and_gradient(jnp.tile(exact[:, :1], 8), jnp.zeros_like(weights))
    np.testing.assert_allclose(np.asarray(by_values)[:, 0], [2, 2, 2, 0, 0, 0], atol=1e-5)
