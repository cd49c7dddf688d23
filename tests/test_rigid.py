"""Rigid motions: group laws and SciPy's rotations, near zero and near pi too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from voxjax import rigid

ANGLES = [0.0, 1e-8, 1e-6, 1e-4, 1e-3, 0.05, 0.0999, 0.1001, 0.5, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-5]


def rotation_vectors(angle: float, count: int = 8) -> np.ndarray:
    axes = np.random.default_rng(0).normal(size=(count, 3))
    axes = np.concatenate([axes, np.eye(3), -np.eye(3)])
    return (angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)).astype(np.float32)


def tangents(angle: float) -> np.ndarray:
    omega = rotation_vectors(angle)
    return np.concatenate(
        [np.random.default_rng(1).uniform(-5, 5, omega.shape).astype(np.float32), omega], axis=1
    )


def expm(matrix: np.ndarray) -> np.ndarray:
    """Power series in float64, halved until it converges."""
    term = total = np.eye(4)
    for n in range(1, 30):
        term = term @ (matrix / 2**8) / n
        total = total + term
    return np.linalg.matrix_power(total, 2**8)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_so3_is_scipys(angle):
    omega = rotation_vectors(angle)
    np.testing.assert_allclose(
        rigid.exp_so3(jnp.asarray(omega)), Rotation.from_rotvec(omega).as_matrix(), atol=1e-6
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_the_matrix_exponential(angle):
    tangent = tangents(angle)[::3]
    for row, T in zip(tangent, np.asarray(rigid.exp(jnp.asarray(tangent))), strict=True):
        generator = np.zeros((4, 4))
        x, y, z = row[3:]
        generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        generator[:3, 3] = row[:3]
        np.testing.assert_allclose(T, expm(generator), atol=5e-6)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_so3_is_scipys(angle):
    matrix = Rotation.from_rotvec(rotation_vectors(angle)).as_matrix().astype(np.float32)
    expected = Rotation.from_matrix(matrix.astype(np.float64)).as_rotvec()
    np.testing.assert_allclose(rigid.log_so3(jnp.asarray(matrix)), expected, atol=3e-6)


@pytest.mark.parametrize("angle", ANGLES[:-1])
def test_log_undoes_exp(angle):
    tangent = tangents(angle)
    np.testing.assert_allclose(rigid.log(rigid.exp(jnp.asarray(tangent))), tangent, atol=2e-5)


@pytest.mark.parametrize("axis", [*np.eye(3).tolist(), [0.6, 0.8, 0.0], [2 / 3, -1 / 3, 2 / 3]])
def test_half_turns_have_a_log_of_length_pi_about_their_axis(axis):
    a = np.asarray(axis)
    matrix = (2 * np.outer(a, a) - np.eye(3)).astype(np.float32)
    omega = np.asarray(rigid.log_so3(jnp.asarray(matrix)))
    np.testing.assert_allclose(np.linalg.norm(omega), np.pi, atol=1e-6)
    np.testing.assert_allclose(np.abs(omega @ a), np.pi, atol=1e-5)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_pose_times_its_inverse_is_the_identity(angle):
    T = rigid.exp(jnp.asarray(tangents(angle)))
    identity = np.broadcast_to(np.eye(4), T.shape)
    np.testing.assert_allclose(rigid.inverse(T) @ T, identity, atol=5e-6)
    np.testing.assert_allclose(T @ rigid.inverse(T), identity, atol=5e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_inverse_of_host_poses_stays_on_the_host(dtype):
    T = np.asarray(rigid.exp(jnp.asarray(tangents(2.0)))).astype(dtype)
    found = rigid.inverse(T)
    assert isinstance(found, np.ndarray)
    assert found.dtype == dtype
    np.testing.assert_allclose(found, np.linalg.inv(T), atol=5e-6)
    np.testing.assert_array_equal(rigid.inverse(T[3]), found[3])
    np.testing.assert_allclose(rigid.inverse(jnp.asarray(T, jnp.float32)), found, atol=5e-6)


@pytest.mark.parametrize("place", [np.asarray, jnp.asarray])
def test_the_nearest_rotation_is_scipys_and_never_a_reflection(place):
    rng = np.random.default_rng(5)
    points = rng.normal(size=(40, 6, 3)).astype(np.float32)
    turned = points + rng.normal(size=points.shape).astype(np.float32)
    turned[::2, :, 0] *= -1.0  # The best orthogonal matrix of such points is often a reflection.
    covariance = np.einsum("knx,kny->kxy", turned, points)
    assert (np.linalg.det(covariance) < 0).sum() > 5
    found = rigid.nearest_rotation(place(covariance))
    assert isinstance(found, np.ndarray) == (place is np.asarray)
    assert found.dtype == np.float32
    np.testing.assert_allclose(np.linalg.det(np.asarray(found)), 1.0, atol=1e-5)
    for rotation, a, b in zip(np.asarray(found), turned, points, strict=True):
        expected = Rotation.align_vectors(a.astype(np.float64), b.astype(np.float64))[0]
        np.testing.assert_allclose(rotation, expected.as_matrix(), atol=2e-4)
    np.testing.assert_allclose(rigid.nearest_rotation(place(covariance[1])), found[1], atol=1e-5)


def test_apply_moves_points_of_b_into_a():
    T_a_b = jnp.asarray([[0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]], jnp.float32)
    points = jnp.asarray([[1, 2, 3], [0, 0, 0]], jnp.float32)
    np.testing.assert_array_equal(rigid.apply(T_a_b, points), [[8, 21, 33], [10, 20, 30]])
    np.testing.assert_array_equal(rigid.apply(T_a_b, points[0]), [8, 21, 33])


def test_poses_act_one_after_another():
    T = rigid.exp(jnp.asarray(tangents(0.7)[:2]))
    points = jnp.asarray(np.random.default_rng(2).normal(size=(5, 3)), jnp.float32)
    np.testing.assert_allclose(
        rigid.apply(T[0] @ T[1], points), rigid.apply(T[0], rigid.apply(T[1], points)), atol=1e-5
    )


def test_hat_is_the_cross_product():
    a, b = jnp.asarray(np.random.default_rng(3).normal(size=(2, 6, 3)), jnp.float32)
    np.testing.assert_allclose((rigid.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-6)


def test_gradients_of_the_round_trip_are_the_identity_and_finite_even_at_pi():
    rows = jnp.asarray(np.stack([tangents(angle)[0] for angle in ANGLES]))

    def round_trip(tangent):
        return rigid.log(rigid.exp(tangent))

    forward = np.asarray(jax.jit(jax.vmap(jax.jacfwd(round_trip)))(rows))
    _, pull_back = jax.vjp(jax.jit(jax.vmap(round_trip)), rows)
    (backward,) = pull_back(jnp.ones_like(rows))
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(backward, forward.sum(axis=1), atol=1e-2)
    below_pi = np.asarray(ANGLES) < 3.0
    np.testing.assert_allclose(
        forward[below_pi], np.broadcast_to(np.eye(6), forward[below_pi].shape), atol=2e-3
    )
