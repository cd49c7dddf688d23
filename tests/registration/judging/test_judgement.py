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
    nothing = no_judgement(2.0, has_free_space=True)
    assert nothing.joined(both).score().tolist() == both.score().tolist()


def test_a_pose_beside_the_truth_hits_but_does_not_lie_on_it(pair):
    a, b, truth = pair
    # A voxel is within the tolerance of a hit, and beyond that of a plane.
    poses = np.stack([truth, pose(translation=(0.15, 0.15, 0.15)) @ truth]).astype(np.float32)
    found = judge_poses(a.prepared, b.prepared, poses, num_points=None)
    assert found.hits[1] > 0.5 * found.hits[0]
    assert found.exact[0] > 0.4
    assert found.exact[1] < 0.2 * found.exact[0]
    coarse = judge_poses(a.prepared, b.prepared, poses, num_points=256, is_coarse=True)
    np.testing.assert_array_equal(coarse.exact, 0.0)


def test_strength_is_the_score_or_without_free_space_what_agrees_exactly(pair):
    a, b, truth = pair
    found = judge_poses(a.prepared, b.prepared, truth[None].astype(np.float32), num_points=256)
    assert found.has_free_space
    np.testing.assert_array_equal(found.strength(), found.score())
    one = np.ones(1)
    blind = found._replace(
        hits=0.6 * one, conflicts=0 * one, exact=0.2 * one, exact_hits=0.3 * one, has_free_space=False
    )
    np.testing.assert_allclose(blind.strength(), 0.6 * 0.2 * 0.5**2)
    opposed = blind._replace(conflicts=0.3 / blind.conflict_weight * one)
    np.testing.assert_allclose(opposed.strength(), 0.5 * blind.strength())
    assert blind._replace(conflicts=one).strength() < 0
