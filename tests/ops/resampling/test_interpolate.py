"""Whole-grid kernels: the definitions, transformations of JAX, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from oracles import resampling as oracle
from voxjax import rigid
from voxjax.ops.resampling.interpolate import backward_affine, resample_nearest, resample_trilinear
from voxjax.ops.resampling.rigid import source_from_target


def make_states(seed=0, shape=(6, 5, 4)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 3, shape).astype(np.uint8)


@pytest.mark.parametrize("dtype", [np.uint8, np.bool_, np.int32, np.float32])
def test_nearest_keeps_the_dtype_and_is_vmapped(dtype):
    values = make_states().astype(dtype)
    affine = jnp.asarray(np.eye(4, dtype=np.float32)[:3])
    out = jax.vmap(lambda v: resample_nearest(v, affine, target_shape=(7, 5, 3)))(jnp.stack([values, values]))
    assert out.dtype == dtype
    np.testing.assert_array_equal(out[1, :6], values[:, :, :3])
    assert not np.asarray(out[:, 6:]).any()


@pytest.mark.parametrize("seed", range(3))
def test_trilinear_is_linear_between_centres(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(4, 3, 5)).astype(np.float32)
    affine = np.concatenate([Rotation.random(rng=rng).as_matrix(), rng.uniform(0, 3, (3, 1))], 1).astype(
        np.float32
    )
    out = resample_trilinear(values, affine, target_shape=(4, 4, 4))
    np.testing.assert_allclose(out, oracle.trilinear(values, affine, (4, 4, 4)), atol=2e-5)


@given(st.integers(0, 2**32 - 1), st.sampled_from([(1, 1, 1), (1, 6, 2), (5, 3, 4)]))
@settings(max_examples=15, deadline=None)
def test_trilinear_of_any_motion_is_that_of_the_loop_inside_and_outside(seed, shape):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape).astype(np.float32)
    turn = Rotation.random(rng=rng).as_matrix() * rng.uniform(0.3, 2.0)
    affine = np.concatenate([turn, rng.uniform(-2, 6, (3, 1))], 1).astype(np.float32)
    out = resample_trilinear(values, affine, target_shape=(3, 5, 4))
    np.testing.assert_allclose(out, oracle.trilinear(values, affine, (3, 5, 4)), atol=2e-5)


def test_nothing_outside_the_source_is_read_even_with_weight_zero():
    values = np.full((2, 2, 2), np.inf, np.float32)
    affine = np.concatenate([np.eye(3), np.full((3, 1), -4)], 1).astype(np.float32)
    out = np.asarray(resample_trilinear(values, affine, target_shape=(9, 9, 9)))
    far = np.ones(out.shape, bool)
    far[3:6, 3:6, 3:6] = False
    assert (out[far] == 0).all()


@pytest.mark.parametrize("resample", [resample_nearest, resample_trilinear])
def test_a_source_without_voxels_gives_zeros(resample):
    affine = np.eye(4, dtype=np.float32)[:3]
    out = resample(np.zeros((0, 2, 2), np.float32), affine, target_shape=(2, 3, 1))
    assert out.dtype == np.float32
    np.testing.assert_array_equal(out, np.zeros((2, 3, 1)))


def test_trilinear_under_vmap_over_poses_equals_one_by_one():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(5, 4, 6)).astype(np.float32)
    turns = Rotation.random(3, rng=rng).as_matrix()
    affines = np.concatenate([turns, rng.uniform(0, 4, (3, 3, 1))], 2).astype(np.float32)
    batched = jax.vmap(lambda affine: resample_trilinear(values, affine, target_shape=(4, 4, 4)))(affines)
    for affine, out in zip(affines, batched, strict=True):
        np.testing.assert_allclose(out, oracle.trilinear(values, affine, (4, 4, 4)), atol=2e-5)


def test_the_gradient_in_the_values_is_the_transposed_map():
    """<g, R v> = <R^T g, v> with R from the loop, also where cells are cut by the border."""
    rng = np.random.default_rng(1)
    values, cotangent = rng.uniform(1, 2, (3, 4, 2)), rng.uniform(1, 2, (5, 5, 5))
    turn = Rotation.from_euler("xyz", (0.3, -0.2, 0.5)).as_matrix()
    affine = np.concatenate([turn, [[-0.6], [-1.3], [-0.8]]], 1).astype(np.float32)
    back = jax.grad(
        lambda v: jnp.sum(
            resample_trilinear(v, affine, target_shape=(5, 5, 5)) * cotangent.astype(np.float32),
            dtype=jnp.float32,
        )
    )(values.astype(np.float32))
    expected = np.sum(cotangent * oracle.trilinear(values, affine, (5, 5, 5)))
    assert expected > 1.0
    np.testing.assert_allclose(np.sum(np.asarray(back, np.float64) * values), expected, rtol=1e-4)


@pytest.mark.parametrize("shift", [-0.8, 3.4])
def test_the_gradient_in_the_pose_holds_in_cells_cut_by_the_border(shift):
    values = np.random.default_rng(2).normal(size=(4, 4, 4)).astype(np.float32)

    def total(offset):
        affine = jnp.concatenate([jnp.eye(3, dtype=jnp.float32), offset[:, None]], axis=1)
        return jnp.sum(resample_trilinear(values, affine, target_shape=(1, 2, 2)), dtype=jnp.float32)

    at = np.array([shift, 0.7, 1.2], np.float32)
    slopes = [float(total(at + s) - total(at - s)) / 0.1 for s in 0.05 * np.eye(3, dtype=np.float32)]
    assert abs(slopes[0]) > 0.1
    np.testing.assert_allclose(jax.grad(total)(jnp.asarray(at)), slopes, rtol=1e-3, atol=1e-4)


def test_trilinear_gradients_are_those_of_finite_differences():
    rng = np.random.default_rng(0)
    ramp = np.stack(np.meshgrid(*3 * [np.arange(8)], indexing="ij")).astype(np.float32)
    values = jnp.asarray(ramp[0] * ramp[1] + 0.3 * ramp[2])
    affine = jnp.asarray(np.concatenate([np.eye(3), [[2.2], [1.7], [2.4]]], 1), jnp.float32)

    def total(values, affine):
        return jnp.sum(resample_trilinear(values, affine, target_shape=(2, 2, 2)) ** 2, dtype=jnp.float32)

    by_values, by_pose = jax.grad(total, argnums=(0, 1))(values, affine)
    for argument, gradient, step in ((0, by_values, 1e-1), (1, by_pose, 1e-3)):
        direction = jnp.asarray(rng.normal(size=gradient.shape), jnp.float32)
        ends = [
            total(*(a + s * step * direction if n == argument else a for n, a in enumerate((values, affine))))
            for s in (1.0, -1.0)
        ]
        slope = float(ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(float(jnp.sum(gradient * direction)), slope, rtol=1e-2)


def test_the_affine_map_is_that_of_the_host_code():
    rng = np.random.default_rng(0)
    T = np.asarray(rigid.exp(jnp.asarray(rng.normal(size=6), jnp.float32)))
    source, cell = rng.uniform(-3, 3, 3).astype(np.float32), rng.integers(-9, 9, 3)
    ours = backward_affine(T, source, 0.2, (cell * 0.1).astype(np.float32), 0.1)
    np.testing.assert_allclose(ours, source_from_target(T, source, 0.2, cell, 0.1), atol=1e-5)


def test_a_pose_is_found_by_descending_the_gradient():
    grid = np.stack(np.meshgrid(*3 * [np.arange(12.0)], indexing="ij"), axis=-1)
    values = jnp.asarray(np.exp(-((grid - [5, 6, 5]) ** 2 / [4, 9, 14]).sum(axis=-1)), jnp.float32)
    origin, truth = jnp.zeros(3, jnp.float32), jnp.asarray([0.06, -0.04, 0.05, 0.02, 0.01, 0.05], jnp.float32)

    def moved(tangent):
        return resample_trilinear(
            values, backward_affine(rigid.exp(tangent), origin, 0.1, origin, 0.1), target_shape=(12, 12, 12)
        )

    target = moved(truth)
    loss = jax.jit(
        jax.value_and_grad(lambda tangent: jnp.sum((moved(tangent) - target) ** 2, dtype=jnp.float32))
    )
    tangent = jnp.zeros(6, jnp.float32)
    start, _ = loss(tangent)
    for _ in range(100):
        _, gradient = loss(tangent)
        tangent = tangent - 1e-4 * gradient
    assert float(loss(tangent)[0]) < 0.05 * float(start)
