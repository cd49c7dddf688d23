"""Dominant directions of the surface of a map."""

import numpy as np

from voxjax.registration.hypotheses.directions import dominant_directions, is_free_to_turn
from voxjax.registration.hypotheses.settings import RotationConfig

AXES = np.eye(3)


def noisy_normals(axes, counts, degrees, seed):
    rng = np.random.default_rng(seed)
    normals = np.repeat(axes, counts, axis=0)
    normals = normals + np.radians(degrees) * rng.normal(size=normals.shape)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def test_directions_are_the_axes_of_the_surface():
    normals = noisy_normals(np.concatenate([AXES, -AXES]), [400, 300, 200, 400, 100, 250], 3.0, 0)
    directions, shares = dominant_directions(normals, np.ones(len(normals), np.float32))
    found = np.abs(directions[:3] @ AXES.T)
    assert (found.max(axis=1) > np.cos(np.radians(1.0))).all()
    assert sorted(found.argmax(axis=1)) == [0, 1, 2]
    assert (np.diff(shares) <= 1e-9).all()


def test_few_strong_directions_are_taken_and_weak_ones_left_out():
    normals = noisy_normals(AXES, [400, 300, 2], 1.0, 1)
    weights = np.ones(len(normals), np.float32)
    assert len(dominant_directions(normals, weights)[0]) == 2
    all_of_three = RotationConfig(min_share=0.0, max_directions=3)
    assert len(dominant_directions(normals, weights, settings=all_of_three)[0]) == 3
    (first,), (share,) = dominant_directions(normals, weights, settings=RotationConfig(max_directions=1))
    assert abs(first @ AXES[0]) > 0.999
    np.testing.assert_allclose(share, 400 / 702, atol=0.02)


def test_peaks_nearer_than_what_a_direction_takes_are_one():
    turned = np.array([[1.0, 0.0, 0.0], [np.cos(np.radians(15)), np.sin(np.radians(15)), 0.0]])
    normals = noisy_normals(turned, [400, 300], 0.5, 2)
    weights = np.ones(len(normals), np.float32)
    assert len(dominant_directions(normals, weights)[0]) == 2
    wide = RotationConfig(taken_degrees=20.0)
    assert len(dominant_directions(normals, weights, settings=wide)[0]) == 1


def test_no_normals_have_no_directions():
    directions, shares = dominant_directions(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    assert directions.shape == (0, 3)
    assert shares.shape == (0,)


def test_ground_with_trees_leaves_all_turns_open_and_walls_do_not():
    settings = RotationConfig()
    ground = np.stack([AXES[2], [0.0, 0.2, 0.98], AXES[0]])
    assert is_free_to_turn(ground, np.asarray([0.8, 0.1, 0.02]), settings)
    assert not is_free_to_turn(ground, np.asarray([0.6, 0.1, 0.08]), settings)
    assert is_free_to_turn(AXES[:1], np.ones(1), settings)
    assert is_free_to_turn(np.zeros((0, 3)), np.zeros(0), settings)
