"""Rigid motions: accuracy and derivatives in float64 and float32, the laws of the group, half-turns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import rigid

PI = np.pi
AXES = [(1.0, 0, 0), (0, 1.0, 0), (0, 0, -1.0), (0.6, 0.8, 0), (0, -0.6, 0.8), (2 / 3, -1 / 3, 2 / 3)]
DIAGONALS = [(1, 1, 0), (1, 0, -1), (0, 1, 1), (1, 1, 1), (-1, 1, 1), (1, -1, -1)]
HALF_TURN_AXES = [np.asarray(axis) / np.linalg.norm(axis) for axis in [*AXES, *DIAGONALS]]
EXP, LOG = jax.jit(rigid.exp), jax.jit(rigid.log)
# Both sides of the bounds between series and quotients: 0.1 and 1 rad, 2e-4 and 0.2 rad.
ANGLES = [
    0.0,
    1e-12,
    1e-8,
    1e-4,
    2.1e-4,
    0.01,
    0.0999,
    0.1001,
    0.199,
    0.201,
    0.999,
    1.001,
    2.0,
    3.0,
    PI - 1e-3,
]


def tangents(angles=ANGLES) -> np.ndarray:
    move = np.random.default_rng(0).uniform(-2, 2, (len(AXES), 3))
    return np.concatenate([np.concatenate([move, angle * np.asarray(AXES)], axis=1) for angle in angles])


def poses(seed: int) -> jax.Array:
    return EXP(jnp.asarray(np.random.default_rng(seed).uniform(-1.5, 1.5, (20, 6))))


def derivatives(function) -> tuple:
    """Jacobians of a function of a row, for all rows at once: forward and reverse."""
    return tuple(jax.jit(jax.vmap(jacobian(function))) for jacobian in (jax.jacfwd, jax.jacrev))


def exponential(x: np.ndarray) -> np.ndarray:
    """Scaled power series in float64."""
    matrix = np.zeros((4, 4))
    a, b, c = x[3:]
    matrix[:3] = np.asarray([[0, -c, b, x[0]], [c, 0, -a, x[1]], [-b, a, 0, x[2]]])
    matrix, total, term = matrix / 16, np.eye(4), np.eye(4)
    for n in range(1, 25):
        term = term @ matrix / n
        total = total + term
    return np.linalg.matrix_power(total, 16)


def central_differences(function, rows: np.ndarray, step: float) -> np.ndarray:
    """Jacobian of a function of many rows, to fourth order in the step."""
    columns = []
    for direction in np.eye(rows.shape[-1], dtype=rows.dtype) * rows.dtype.type(step):
        near, far = (
            np.asarray(function(rows + k * direction), np.float64)
            - np.asarray(function(rows - k * direction), np.float64)
            for k in (rows.dtype.type(1), rows.dtype.type(2))
        )
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


def test_float64_stays_and_is_accurate_to_its_last_digits():
    x = tangents()
    with jax.enable_x64(True):
        T = EXP(x)
        back = LOG(T)
        assert T.dtype == back.dtype == rigid.adjoint(T).dtype == rigid.inverse(T).dtype == jnp.float64
        np.testing.assert_allclose(T, [exponential(row) for row in x], atol=2e-14)
        np.testing.assert_allclose(back, x, atol=2e-13)


def test_derivatives_of_exp_are_those_of_differences_in_both_modes():
    x = tangents()
    with jax.enable_x64(True):
        forward, backward = (np.asarray(jacobian(x)) for jacobian in derivatives(rigid.exp))
        expected = central_differences(EXP, x, 2e-3)
    np.testing.assert_allclose(forward, expected, atol=1e-10)
    np.testing.assert_allclose(backward, forward, atol=1e-13)


def test_derivatives_of_log_undo_those_of_exp_in_both_modes():
    """The first order of log at T = exp(x), along the group; matrices off the group have no logarithm."""
    x = tangents()
    with jax.enable_x64(True):
        for jacobian in derivatives(lambda tangent: rigid.log(rigid.exp(tangent))):
            np.testing.assert_allclose(jacobian(x), np.broadcast_to(np.eye(6), (len(x), 6, 6)), atol=1e-11)


@pytest.mark.parametrize("is_double", [False, True])
def test_derivatives_of_log_of_a_product_are_those_of_differences(is_double):
    """As in a pose graph: log(A exp(x)) at x = 0."""
    dtype, step, tolerance = (np.float64, 1e-3, 1e-6) if is_double else (np.float32, 0.02, 5e-3)
    at = tangents([0.0, 1e-8, 0.05, 0.0999, 0.1001, 0.999, 1.001, 2.0, 3.0]).astype(dtype)
    with jax.enable_x64(is_double):

        def product(x, at):
            return rigid.log(rigid.exp(at) @ rigid.exp(x))

        zero = np.zeros_like(at)
        batched = jax.jit(jax.vmap(product))
        expected = central_differences(lambda x: batched(x, at), zero, step)
        for jacobian in derivatives(lambda row: product(row[:6], row[6:])):
            found = np.asarray(jacobian(np.concatenate([zero, at], axis=1)))[..., :6]
            assert found.dtype == dtype
            np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_half_turns_have_finite_derivatives_of_one_side(dtype):
    tight = 1e-12 if dtype == np.float64 else 3e-6
    axes = np.stack(HALF_TURN_AXES)
    T = np.tile(np.eye(4, dtype=dtype), (len(axes), 1, 1))
    T[:, :3, :3] = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    T[:, :3, 3] = [0.3, -2.0, 1.0]
    with jax.enable_x64(dtype == np.float64):
        tangent = LOG(T)
        omega = np.asarray(tangent)[:, 3:]
        np.testing.assert_allclose(np.linalg.norm(omega, axis=1), PI, atol=tight)
        np.testing.assert_allclose(EXP(tangent), T, atol=4 * tight)
        for jacobian in derivatives(rigid.log_so3):
            assert np.isfinite(np.asarray(jacobian(T[:, :3, :3]))).all()

        def turned(row):
            return rigid.log(rigid.exp(row[:6]) @ row[6:].reshape(4, 4))

        rows = np.concatenate([np.zeros((len(T), 6), dtype), T.reshape(-1, 16)], axis=1)
        forward, backward = (np.asarray(jacobian(rows))[..., :6] for jacobian in derivatives(turned))
    np.testing.assert_allclose(backward, forward, atol=20 * tight)
    # log jumps from pi to -pi here; on the side that it chose, turning on along the axis turns by as much.
    along = np.einsum("nij,nj->ni", forward[:, 3:, 3:], axes)
    np.testing.assert_allclose(along, axes, atol=20 * tight)


@pytest.mark.parametrize("is_double", [False, True])
def test_identity_and_huge_turns_have_finite_derivatives(is_double):
    rows = np.stack([np.zeros(6), np.asarray([1, 2, 3, 0, 0, 0]), np.full(6, 50.0)])
    rows = rows.astype(np.float64 if is_double else np.float32)

    def round_trip(x):
        return rigid.log(rigid.exp(x))

    with jax.enable_x64(is_double):
        for jacobian in derivatives(round_trip):
            assert np.isfinite(np.asarray(jacobian(rows))).all()


def test_poses_are_a_group():
    with jax.enable_x64(True):
        A, B, C = poses(1), poses(2), poses(3)
        identity = np.broadcast_to(np.eye(4), A.shape)
        np.testing.assert_allclose((A @ B) @ C, A @ (B @ C), atol=1e-13)
        np.testing.assert_allclose(rigid.inverse(A) @ A, identity, atol=1e-14)
        np.testing.assert_allclose(rigid.inverse(A @ B), rigid.inverse(B) @ rigid.inverse(A), atol=1e-13)
        np.testing.assert_allclose(rigid.inverse(rigid.inverse(A)), A, atol=1e-14)
        np.testing.assert_array_equal(EXP(np.zeros(6)), np.eye(4))
        np.testing.assert_array_equal(LOG(np.eye(4)), np.zeros(6))


def test_the_exponential_of_the_negative_is_the_inverse():
    with jax.enable_x64(True):
        x = tangents()
        np.testing.assert_allclose(EXP(-x), rigid.inverse(EXP(x)), atol=1e-14)
        np.testing.assert_allclose(EXP(0.3 * x) @ EXP(0.7 * x), EXP(x), atol=1e-13)


@pytest.mark.parametrize("is_double", [False, True])
def test_the_adjoint_moves_tangents_through_a_pose(is_double):
    with jax.enable_x64(is_double):
        T, S = poses(4), poses(5)
        x = jnp.asarray(np.random.default_rng(6).uniform(-1, 1, (20, 6)))
        atol = 1e-13 if is_double else 1e-5
        moved = (rigid.adjoint(T) @ x[..., None])[..., 0]
        np.testing.assert_allclose(EXP(moved), T @ EXP(x) @ rigid.inverse(T), atol=atol)
        np.testing.assert_allclose(rigid.adjoint(T @ S), rigid.adjoint(T) @ rigid.adjoint(S), atol=atol)
        inverted = rigid.adjoint(rigid.inverse(T))
        np.testing.assert_allclose(inverted, np.linalg.inv(np.asarray(rigid.adjoint(T))), atol=atol)


def test_a_covariance_moves_by_the_adjoint_as_its_samples_do():
    """Small left tangents of a pose about the origin, told about a centre instead."""
    with jax.enable_x64(True):
        to_centre = rigid.from_rotation_translation(jnp.eye(3), jnp.asarray([3.0, -1.0, 2.0]))
        samples = jnp.asarray(np.random.default_rng(7).normal(size=(500, 6)) * 1e-5)
        moved = jax.vmap(lambda x: rigid.log(to_centre @ rigid.exp(x) @ rigid.inverse(to_centre)))(samples)
        A = np.asarray(rigid.adjoint(to_centre))
        np.testing.assert_allclose(
            np.cov(np.asarray(moved).T), A @ np.cov(np.asarray(samples).T) @ A.T, rtol=1e-6
        )
