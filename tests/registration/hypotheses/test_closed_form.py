import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.matching import horn_alignment
from oracles.motions import moved, pose_error, random_pose
from voxjax.registration.hypotheses.closed_form import align_points, is_degenerate


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), far=st.sampled_from([0.0, 50.0]), noise=st.sampled_from([0.0, 0.1]))
def test_equals_the_quaternion_method(seed, far, noise):
    rng = np.random.default_rng(seed)
    b = rng.uniform(far, far + 8, (12, 3))
    T = random_pose(rng)
    a = moved(T, b) + rng.normal(0, noise, b.shape) if noise else moved(T, b)
    weights = rng.uniform(0.1, 2.0, 12)
    found = align_points(a.astype(np.float32), b.astype(np.float32), weights.astype(np.float32))
    # Points of float32 at 60 m are rounded to 4 micrometres.
    degrees, metres = pose_error(found, horn_alignment(a, b, weights), b.mean(axis=0))
    assert degrees < 2e-3
    assert metres < 1e-4


def test_points_of_weight_zero_do_not_count_whatever_they_hold():
    rng = np.random.default_rng(1)
    b = rng.uniform(0, 5, (8, 3)).astype(np.float32)
    T = random_pose(rng)
    a = moved(T, b).astype(np.float32)
    padded_a = np.concatenate([a, np.full((4, 3), np.nan, np.float32)])
    padded_b = np.concatenate([b, np.full((4, 3), 1e6, np.float32)])
    weights = np.array([1.0] * 8 + [0.0] * 4, np.float32)
    np.testing.assert_allclose(align_points(padded_a, padded_b, weights), align_points(a, b), atol=1e-5)


def test_mirrored_points_give_a_rotation_not_a_reflection():
    rng = np.random.default_rng(2)
    b = rng.normal(size=(20, 3)).astype(np.float32)
    T = np.asarray(align_points(b * np.array([1, 1, -1], np.float32), b))
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-5)


def test_swapping_the_clouds_inverts_the_pose():
    rng = np.random.default_rng(3)
    b = rng.normal(size=(9, 3)).astype(np.float32)
    a = moved(random_pose(rng), b).astype(np.float32)
    product = np.asarray(align_points(a, b)) @ np.asarray(align_points(b, a))
    np.testing.assert_allclose(product, np.eye(4), atol=1e-5)


def test_coplanar_points_fix_the_pose():
    rng = np.random.default_rng(4)
    b = np.concatenate([rng.normal(size=(6, 2)), np.zeros((6, 1))], axis=1).astype(np.float32)
    T = random_pose(rng)
    found = align_points(moved(T, b).astype(np.float32), b)
    assert pose_error(found, T, np.zeros(3))[0] < 1e-2
    assert not is_degenerate(b)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2], [5, 5, 5]], True),
        ([[1, 2, 3]] * 4, True),
        ([[0, 0, 0], [1, 0, 0]], True),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], False),
    ],
)
def test_points_on_a_line_are_degenerate(points, expected):
    for offset in (0.0, 100.0):
        assert bool(is_degenerate(np.asarray(points, np.float32) + np.float32(offset))) == expected


def test_no_weight_at_all_gives_the_identity():
    points = np.ones((4, 3), np.float32)
    np.testing.assert_array_equal(align_points(points, points, np.zeros(4, np.float32)), np.eye(4))


def test_vmap_equals_one_by_one():
    rng = np.random.default_rng(5)
    b = rng.normal(size=(6, 5, 3)).astype(np.float32)
    a = np.stack([moved(random_pose(rng), x) for x in b]).astype(np.float32)
    batched = jax.vmap(align_points)(a, b)
    for k in range(6):
        np.testing.assert_allclose(batched[k], align_points(a[k], b[k]), atol=1e-5)


def test_gradient_equals_finite_differences():
    rng = np.random.default_rng(6)
    b = rng.normal(size=(7, 3)).astype(np.float32)
    a = (moved(random_pose(rng), b) + rng.normal(0, 0.05, (7, 3))).astype(np.float32)
    direction = rng.normal(size=(7, 3)).astype(np.float32)

    def probe(step):
        return jnp.sum(align_points(a + step * direction, b)[:3] ** 3, dtype=jnp.float32)

    step = 1e-2
    numeric = (probe(jnp.float32(step)) - probe(jnp.float32(-step))) / (2 * step)
    assert float(jax.grad(probe)(jnp.float32(0.0))) == pytest.approx(float(numeric), rel=2e-2)
