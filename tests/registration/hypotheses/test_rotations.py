import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from voxjax.maps.prepared import draw_rows
from voxjax.registration.hypotheses.directions import dominant_directions
from voxjax.registration.hypotheses.distinct import distinct_rows
from voxjax.registration.hypotheses.rotations import (
    pair_rotations,
    rotation_hypotheses,
    sharpen_rotations,
    turned_about,
)

AXES = np.asarray([[1, 0, 0], [0, 1, 0], [0, 0, 1]], float)


def noisy_normals(axes, counts, degrees, seed):
    rng = np.random.default_rng(seed)
    normals = np.repeat(axes, counts, axis=0)
    normals = normals + np.radians(degrees) * rng.normal(size=normals.shape)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def angle(R):
    return np.degrees(Rotation.from_matrix(R).magnitude())


def test_two_axes_systems_match_in_24_rotations():
    R = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    rotations = pair_rotations(AXES, AXES @ R)
    kept = distinct_rows(rotations, degrees=4.0)
    assert len(kept) == 24
    assert min(angle(r.T @ R) for r in rotations) < 1e-3


def test_directions_at_other_angles_do_not_match():
    skew = np.asarray([[1, 0, 0], [np.cos(1.0), np.sin(1.0), 0]])
    assert len(pair_rotations(AXES[:2], skew)) == 0


def test_directions_too_near_to_each_other_propose_nothing():
    near = np.array([[1.0, 0.0, 0.0], [np.cos(np.radians(20)), np.sin(np.radians(20)), 0.0]])
    assert len(pair_rotations(near, near)) == 0
    assert len(pair_rotations(near, near, min_angle=15.0)) > 0


def test_signed_normals_single_out_the_rotation():
    axes = np.concatenate([AXES, -AXES])
    counts = [100, 300, 200, 250, 150, 120]
    R = Rotation.random(rng=np.random.default_rng(7)).as_matrix()
    a = noisy_normals(axes, counts, 2.0, 1)
    b = noisy_normals(axes @ R, counts, 2.0, 2)
    seen = [n[draw_rows(np.ones(len(n)), 512)] for n in (a, b)]
    found = [dominant_directions(n, np.ones(len(n), np.float32))[0] for n in (a, b)]
    rotations, agreement = rotation_hypotheses(*seen, *found, is_signed=True)
    assert len(rotations) == 24
    assert angle(rotations[0].T @ R) < 0.5
    assert (np.diff(agreement) <= 0).all()
    upright, _ = rotation_hypotheses(*seen, *found, is_signed=True, max_lean=8.0)
    assert all(r[2, 2] > np.cos(np.radians(12)) for r in upright)


def test_no_directions_give_no_rotations():
    normals = np.zeros((512, 3), np.float32)
    rotations, agreement = rotation_hypotheses(
        normals, normals, np.zeros((0, 3)), np.zeros((0, 3)), is_signed=False
    )
    assert rotations.shape == (0, 3, 3)
    assert agreement.shape == (0,)


@pytest.mark.parametrize("is_signed", [True, False])
def test_sharpening_climbs_and_stays_a_rotation(is_signed):
    normals = noisy_normals(np.concatenate([AXES, -AXES]), [80] * 6, 2.0, 3)[: 6 * 80]
    start = Rotation.from_rotvec([[0.05, -0.04, 0.06], [0.0, 0.08, 0.0]]).as_matrix().astype(np.float32)
    before = sharpen_rotations(normals, normals, start, np.int32(len(start)), is_signed, num_steps=1)[1]
    sharp, after = sharpen_rotations(normals, normals, start, np.int32(len(start)), is_signed)
    assert (np.asarray(after) >= np.asarray(before) - 1e-6).all()
    for R in np.asarray(sharp, np.float64):
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-5)
        assert np.linalg.det(R) > 0
        assert angle(R) < 0.5


def test_turns_about_a_direction_are_evenly_spread_and_keep_it():
    a, b = (Rotation.random(rng=np.random.default_rng(seed)).as_matrix()[0] for seed in (1, 2))
    found = turned_about(a, b, 12)
    assert found.shape == (24, 3, 3)
    np.testing.assert_allclose(found @ np.swapaxes(found, 1, 2), np.tile(np.eye(3), (24, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0)
    np.testing.assert_allclose(found @ b, np.repeat([a, -a], 12, axis=0), atol=1e-12)
    between = [angle(found[row].T @ found[row + 1]) for row in (*range(11), *range(12, 23))]
    np.testing.assert_allclose(between, 30.0)


def test_where_ground_alone_is_seen_all_turns_are_tried():
    R = Rotation.random(rng=np.random.default_rng(3)).as_matrix()
    a = noisy_normals(AXES[2:], [512], 2.0, 1)
    b = noisy_normals(AXES[2:] @ R, [512], 2.0, 2)
    found = [dominant_directions(n, np.ones(len(n), np.float32))[0] for n in (a, b)]
    assert len(rotation_hypotheses(a, b, *found, is_signed=True)[0]) == 0
    rotations, _ = rotation_hypotheses(a, b, *found, is_signed=True, is_free_to_turn=True)
    assert len(rotations) == 48
    assert min(angle(each.T @ R) for each in rotations.astype(np.float64)) < 6.0
    # The ground of one map is not the sky of the other.
    np.testing.assert_array_less(0.99, rotations[:, 2] @ R[2])
