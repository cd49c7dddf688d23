"""Planes of softly occupied voxels: the definition, the hard case, gradients."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compilations import QUICK
from derivatives import derivatives_at
from oracles import soft_planes as oracle
from voxjax._checks import InputError
from voxjax.ops.surface.moments import surface_moments
from voxjax.ops.surface.neighbourhood import neighbourhood
from voxjax.ops.surface.soft_planes import SoftPlanes, soft_planes

_ROWS = 600
"""More than any list of voxels here has."""


def _wall(seed=0, shape=(14, 12, 11)):
    """States of a noisy tilted wall in front of free space, and the list of its voxels."""
    rng = np.random.default_rng(seed)
    x, y, z = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    height = 0.45 * x + 0.2 * y + 1.0 + rng.uniform(-0.6, 0.6, x.shape)
    states = np.where(np.abs(z - height) < 0.8, 2, np.where(z > height, 1, 0)).astype(np.uint8)
    return states, np.argwhere(states == 2).astype(np.int32)


_BODIES = {
    "single": np.asarray([[2, 2, 2]]),
    "pair": np.asarray([[2, 2, 2], [2, 3, 2]]),
    "line": np.stack([np.arange(12), np.full(12, 3), np.full(12, 3)], axis=1),
    "post": np.argwhere(np.ones((2, 2, 14))),
    "plane": np.argwhere(np.ones((9, 8, 1))),
    "block": np.argwhere(np.ones((8, 8, 8))),
}


def _body(name):
    states = np.zeros((16, 16, 16), np.uint8)
    index = _BODIES[name].astype(np.int32)
    states[tuple(index.T)] = 2
    return states, index


def _soft_planes(occupancy, toward, neighbours):
    """Planes of the listed voxels, padded to the length that all tests share: one kernel serves them."""
    more = _ROWS - len(occupancy)
    planes = soft_planes(np.pad(occupancy, (0, more)), np.pad(toward, ((0, more), (0, 0))), neighbours)
    return SoftPlanes(*(rows[: len(occupancy)] for rows in planes))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([3, 5, 7]))
def test_planes_are_those_of_the_definition(seed, size):
    states, index = _wall(seed, (9, 8, 9))
    rng = np.random.default_rng(seed)
    occupancy = rng.uniform(size=len(index)).astype(np.float32)
    toward = rng.normal(size=(len(index), 3)).astype(np.float32)
    planes = _soft_planes(occupancy, toward, neighbourhood(index, states.shape, size=size))
    assert all(a.dtype == np.float32 for a in planes)
    for row in range(0, len(index), 3):
        weight, mean, covariance = oracle.soft_plane(occupancy, index, row, size)
        values, vectors = np.linalg.eigh(covariance)
        assert float(planes.weight[row]) == pytest.approx(weight, rel=1e-5)
        assert float(planes.planarity[row]) == pytest.approx(oracle.planarity(covariance, weight), abs=1e-4)
        if values[1] - values[0] > 0.02 * values[2]:
            normal = vectors[:, 0] * (1 if vectors[:, 0] @ toward[row] >= 0 else -1)
            if abs(normal @ toward[row]) > 1e-3:
                np.testing.assert_allclose(planes.normal[row], normal, atol=1e-3)
                assert float(planes.offset[row]) == pytest.approx(mean @ normal, abs=3e-3)


@pytest.mark.parametrize("scene", ["wall", *_BODIES])
def test_certain_voxels_have_the_planes_of_the_hard_map(scene):
    states, index = _wall() if scene == "wall" else _body(scene)
    moments = surface_moments(states, index, size=7, reach=3)
    planes = _soft_planes(np.ones(len(index), np.float32), moments.normal, neighbourhood(index, states.shape))
    np.testing.assert_array_equal(planes.weight, moments.num_occupied)
    np.testing.assert_allclose(planes.normal, moments.normal, atol=2e-5)
    np.testing.assert_allclose(planes.offset, moments.offset, atol=2e-5)
    hard = np.clip(1 - 6 * np.asarray(moments.curvature), 0, 1) * (np.asarray(moments.num_occupied) >= 10)
    np.testing.assert_allclose(planes.planarity, hard, atol=5e-6)


def test_a_common_factor_of_the_occupancies_changes_no_plane():
    states, index = _wall(2)
    neighbours = neighbourhood(index, states.shape)
    occupancy = np.random.default_rng(3).uniform(0.2, 1, len(index)).astype(np.float32)
    toward = np.tile(np.asarray([0, 0.1, 1], np.float32), (len(index), 1))
    whole, half = (_soft_planes(o, toward, neighbours) for o in (occupancy, occupancy / 2))
    np.testing.assert_allclose(whole.normal, half.normal, atol=2e-4)
    np.testing.assert_allclose(whole.offset, half.offset, atol=2e-4)
    np.testing.assert_allclose(whole.weight, 2 * half.weight, rtol=1e-6)


def _loss(occupancy, toward, neighbours, weights):
    """A scalar of all results."""
    planes = soft_planes(occupancy, toward, neighbours)
    return sum(jnp.sum(a * w) for a, w in zip(planes, weights, strict=True))


_GRADIENT = jax.jit(jax.grad(_loss))


def _problem(dtype, seed=4):
    states, index = _wall(seed, (8, 7, 8))
    rng = np.random.default_rng(seed)
    occupancy = jnp.asarray(rng.uniform(0.2, 0.95, len(index)), dtype)
    toward = surface_moments(states, index).normal
    weights = [jnp.asarray(rng.normal(size=(len(index), *row)), dtype) for row in ((3,), (), (), ())]
    return occupancy, toward, neighbourhood(index, states.shape), weights


@partial(jax.jit, compiler_options=QUICK)
def _derivatives(occupancy, tangent, *rest):
    """The loss, its derivative along a tangent, and its gradient: one kernel for all three."""
    one = jnp.ones((), occupancy.dtype)
    return derivatives_at(lambda occupancy: _loss(occupancy, *rest), occupancy, tangent, one)


def test_gradients_are_finite_differences_and_both_modes_agree():
    tangent = np.random.default_rng(5).normal(size=len(_problem(np.float32)[0]))
    with jax.enable_x64(True):
        occupancy, *rest = _problem(np.float64)
        _, forward, reverse = _derivatives(occupancy, jnp.asarray(tangent), *rest)
        assert reverse.dtype == np.float64
        step, loss = 1e-6, lambda occupancy: _derivatives(occupancy, jnp.asarray(tangent), *rest)[0]
        differences = np.asarray(
            [
                (loss(occupancy + step * unit) - loss(occupancy - step * unit)) / (2 * step)
                for unit in jnp.eye(len(occupancy))[:: max(len(occupancy) // 20, 1)]
            ]
        )
        at = slice(None, None, max(len(occupancy) // 20, 1))
        np.testing.assert_allclose(reverse[at], differences, rtol=1e-4, atol=1e-4 * np.abs(reverse).max())
        assert float(forward) == pytest.approx(float(jnp.vdot(reverse, tangent)), rel=1e-10)
    single, *rest = _problem(np.float32)
    _, _, found = _derivatives(single, jnp.asarray(tangent, jnp.float32), *rest)
    np.testing.assert_allclose(found, reverse, rtol=2e-3, atol=1e-4 * np.abs(reverse).max())


@pytest.mark.parametrize("scene", ["wall", *_BODIES])
@pytest.mark.parametrize("value", [0.0, 1e-30, 1e-4, 0.5, 1.0])
def test_values_and_gradients_are_finite_everywhere(scene, value):
    states, index = _wall() if scene == "wall" else _body(scene)
    neighbours, count = neighbourhood(index, states.shape), _ROWS
    occupancy = jnp.full(count, value, np.float32)
    toward = np.zeros((count, 3), np.float32)
    planes = soft_planes(occupancy, toward, neighbours)
    weights = [jnp.ones_like(a) for a in planes]
    gradient = _GRADIENT(occupancy, toward, neighbours, weights)
    assert all(np.isfinite(np.asarray(a)).all() for a in (*planes, gradient))
    np.testing.assert_allclose(np.linalg.norm(planes.normal, axis=1), 1, atol=1e-5)
    assert not np.asarray(gradient)[len(index) :].any()


def test_without_weight_there_is_no_plane():
    states, index = _wall()
    count = len(index)
    planes = _soft_planes(
        np.zeros(count, np.float32), np.zeros((count, 3), np.float32), neighbourhood(index, states.shape)
    )
    for values in (planes.weight, planes.planarity, planes.offset):
        assert not np.asarray(values).any()


def test_the_direction_turns_the_normal_and_is_not_differentiated():
    states, index = _wall()
    neighbours, occupancy = neighbourhood(index, states.shape), np.ones(len(index), np.float32)
    toward = jnp.asarray(np.tile(np.asarray([0, 0, 1], np.float32), (len(index), 1)))
    one, other = (soft_planes(occupancy, t, neighbours) for t in (toward, -toward))
    assert (np.asarray(one.normal)[:, 2] >= 0).all()
    defined = np.asarray(one.planarity) > 0.5
    np.testing.assert_array_equal(np.asarray(one.normal)[defined], -np.asarray(other.normal)[defined])
    gradient = jax.grad(lambda t: jnp.sum(soft_planes(occupancy, t, neighbours).normal))(toward)
    assert not np.asarray(gradient).any()


def test_batches_are_one_by_one():
    occupancy, toward, neighbours, _ = _problem(np.float32)
    batch = jnp.stack([occupancy, occupancy * 0.5, 1 - occupancy])
    found = jax.vmap(soft_planes, in_axes=(0, None, None))(batch, toward, neighbours)
    for row, one in enumerate(batch):
        for a, b in zip(found, soft_planes(one, toward, neighbours), strict=True):
            np.testing.assert_allclose(a[row], b, atol=2e-4)


def test_more_occupancies_than_rows_are_named():
    _, _, neighbours, _ = _problem(np.float32)
    length = len(neighbours.place) + 1
    with pytest.raises(InputError, match="at most the"):
        soft_planes(np.ones(length, np.float32), np.ones((length, 3), np.float32), neighbours)
