"""Evidence of poses on the small building."""

import numpy as np

from small_worlds import pose
from voxjax import rigid
from voxjax.registration.judging.judgement import judge_poses, no_judgement


def test_evidence_is_the_same_from_both_sides(pair):
    a, b, truth = pair
    T = np.stack([truth, pose(yaw=50.0) @ truth]).astype(np.float32)
    forward = judge_poses(a.prepared, b.prepared, T, num_points=None)
    backward = judge_poses(b.prepared, a.prepared, np.asarray(rigid.inverse(T)), num_points=None)
    for one, two in ((forward.hits, backward.hits), (forward.conflicts, backward.conflicts)):
        np.testing.assert_allclose(one, two, atol=1e-5)
    spectrum = np.linalg.eigvalsh(forward.information), np.linalg.eigvalsh(backward.information)
    np.testing.assert_allclose(*spectrum, atol=1e-5)


def test_a_map_upon_itself_agrees_in_all_directions(pair):
    a = pair[0].prepared
    found = judge_poses(a, a, np.eye(4, dtype=np.float32)[None], num_points=None)
    np.testing.assert_allclose(found.hits, 1.0, atol=1e-4)
    np.testing.assert_allclose(found.conflicts, 0.0, atol=1e-6)
    assert (3 * np.linalg.eigvalsh(found.information[0])).min() > 0.6


def test_parts_are_taken_and_joined_with_their_weight(pair):
    a, b, truth = pair
    T = np.stack([truth, pose(yaw=50.0) @ truth]).astype(np.float32)
    both = judge_poses(a.prepared, b.prepared, T, num_points=256, conflict_weight=2.0)
    np.testing.assert_array_equal(both.score(), both.hits - 2.0 * both.conflicts)
    again = both.take(np.asarray([0])).joined(both.take(np.asarray([1])))
    for one, two in zip(both, again, strict=True):
        np.testing.assert_array_equal(one, two)
    assert no_judgement(2.0).joined(both).score().tolist() == both.score().tolist()
