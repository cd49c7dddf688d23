"""Sums over the neighbours of listed voxels, and their transpose: the definition, all transformations of JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import soft_planes as oracle
from voxjax._checks import InputError
from voxjax._runtime import placement
from voxjax.ops.surface.neighbourhood import ball_sums, neighbourhood

_SHAPE = (9, 12, 7)


def _index(seed, count, shape=_SHAPE):
    cells = np.random.default_rng(seed).choice(int(np.prod(shape)), count, replace=False)
    return np.stack(np.unravel_index(np.sort(cells), shape), axis=1).astype(np.int32)


def _expected(weights, index, size):
    return np.stack([oracle.ten_sums(weights, index, row, size) for row in range(len(index))], axis=1)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([2, 300, int(np.prod(_SHAPE))]), st.sampled_from([1, 3, 5, 7]))
def test_sums_are_those_of_the_definition(seed, count, size):
    index = _index(seed, count)
    weights = np.random.default_rng(seed).uniform(size=count).astype(np.float32)
    found = ball_sums(weights, neighbourhood(index, _SHAPE, size=size))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, _expected(weights, index, size), rtol=1e-5, atol=1e-4)


def test_unsorted_voxels_of_many_pieces_have_the_same_neighbours():
    shape = (40, 30, 25)
    index = _index(1, 20_000, shape)
    order = np.random.default_rng(2).permutation(len(index))
    weights = np.random.default_rng(3).integers(0, 4, len(index)).astype(np.float32)
    found = np.asarray(ball_sums(weights, neighbourhood(index, shape)))
    shuffled = ball_sums(weights[order], neighbourhood(index[order], shape))
    np.testing.assert_array_equal(found[:, order], shuffled)
    for row in (0, 1, 9_999, 16_383, 16_384, 19_999):
        np.testing.assert_array_equal(found[:, row], oracle.ten_sums(weights, index, row, 7))


def test_the_transpose_and_the_tangent_are_those_of_a_linear_map():
    with jax.enable_x64(True):
        index = _index(4, 200)
        neighbours = neighbourhood(index, _SHAPE)
        rng = np.random.default_rng(5)
        weights, tangent, cotangent = rng.normal(size=200), rng.normal(size=200), rng.normal(size=(10, 200))
        out, moved = jax.jvp(lambda w: ball_sums(w, neighbours), (weights,), (tangent,))
        _, pull = jax.vjp(lambda w: ball_sums(w, neighbours), weights)
        np.testing.assert_allclose(out, _expected(weights, index, 7), rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(moved, _expected(tangent, index, 7), rtol=1e-12, atol=1e-11)
        matrix = np.stack([_expected(unit, index, 7) for unit in np.eye(200)])
        np.testing.assert_allclose(
            pull(jnp.asarray(cotangent))[0], (matrix * cotangent).sum(axis=(1, 2)), rtol=1e-11, atol=1e-10
        )
        _, push = jax.linearize(lambda w: ball_sums(w, neighbours), weights)
        np.testing.assert_allclose(push(tangent), moved, rtol=1e-12, atol=1e-11)


def test_batches_of_weights_and_of_cotangents_are_one_by_one():
    neighbours = neighbourhood(_index(6, 100), _SHAPE)
    weights = np.random.default_rng(7).integers(0, 5, (3, 100)).astype(np.float32)
    found = jax.vmap(ball_sums, in_axes=(0, None))(weights, neighbours)
    for row, one in zip(weights, found, strict=True):
        np.testing.assert_array_equal(one, ball_sums(row, neighbours))
    gradient = jax.grad(lambda w, n: jnp.sum(ball_sums(w, n) ** 2))
    batched = jax.jit(jax.vmap(gradient, in_axes=(0, None)))(weights, neighbours)
    for row, one in zip(weights, batched, strict=True):
        np.testing.assert_array_equal(one, jax.jit(gradient)(row, neighbours))


def test_one_piece_for_all_as_elsewhere_gives_the_same_sums(monkeypatch):
    index = _index(8, 500)
    weights = np.random.default_rng(9).integers(0, 5, 500).astype(np.float32)
    found = ball_sums(weights, neighbourhood(index, _SHAPE))
    monkeypatch.setattr(placement, "backend", lambda: "gpu")
    np.testing.assert_array_equal(found, ball_sums(weights, neighbourhood(index, _SHAPE)))


def test_lists_of_similar_length_have_tables_of_the_same_shapes():
    few, many = (
        neighbourhood(_index(count, count, shape), shape) for count, shape in ((3, (4, 4, 4)), (400, _SHAPE))
    )
    assert [a.shape for a in few] == [a.shape for a in many]


def test_empty_lists_and_padding_have_no_neighbours():
    empty = neighbourhood(np.zeros((0, 3), np.int32), (3, 3, 3))
    np.testing.assert_array_equal(ball_sums(np.ones(5, np.float32), empty), np.zeros((10, 5)))
    assert ball_sums(np.ones(0, np.float32), empty).shape == (10, 0)
    index = _index(10, 30)
    found = np.asarray(ball_sums(np.ones(50, np.float32), neighbourhood(index, _SHAPE)))
    np.testing.assert_array_equal(found[:, :30], _expected(np.ones(30), index, 7))
    np.testing.assert_array_equal(found[:, 30:], np.zeros((10, 20)))


@pytest.mark.parametrize(
    ("index", "size", "message"),
    [
        ([[0, 0, 0]], 4, "odd"),
        ([[0, 0, 0]], 9, "at most 7"),
        ([[0, 0, 3]], 7, "inside the grid"),
        ([[0, -1, 0]], 7, "inside the grid"),
        ([[1, 1, 1], [0, 0, 0], [1, 1, 1]], 7, "once"),
    ],
)
def test_bad_lists_are_named(index, size, message):
    with pytest.raises(InputError, match=message):
        neighbourhood(np.asarray(index, np.int32), (3, 3, 3), size=size)
