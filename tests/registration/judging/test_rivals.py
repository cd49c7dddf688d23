"""Which of several poses that agree alike comes first."""

import numpy as np
import pytest

from small_worlds import pose
from voxjax.registration.judging.judgement import Judgement, judge_poses
from voxjax.registration.judging.leaders import Leaders, Tried
from voxjax.registration.judging.rivals import net_strengths, rivals, weigh_rivals
from voxjax.registration.judging.settings import VerdictConfig

BOUNDS = VerdictConfig()


def judgement(*poses):
    """Each pose: its hits, and surface in conflicts that hang together, of 1000 m^2 that agree."""
    hits, pieces = np.asarray(poses, np.float64).T
    nothing = np.zeros(len(hits))
    shared = np.full(len(hits), 1000.0)
    information = np.zeros((len(hits), 3, 3))
    return Judgement(hits, nothing, nothing, information, nothing, nothing, pieces, shared, nothing, nothing)


def test_only_what_is_beyond_the_cleanest_rival_counts():
    both = judgement((0.6, 2.0), (0.5, 2.0), (0.1, 0.0))
    np.testing.assert_array_equal(rivals(both), [True, True, False])
    np.testing.assert_allclose(net_strengths(both), both.strength())
    one = judgement((0.6, 3000.0 * BOUNDS.usual_pieces), (0.5, 0.0))
    np.testing.assert_allclose(net_strengths(one), [0.15, 0.5])


def test_a_pose_without_support_is_no_rival():
    assert not rivals(judgement((0.0, 0.0), (-0.5, 0.0))).any()


def test_the_cleaner_of_two_rivals_comes_first(pair):
    a, b, truth = pair
    poses = np.stack([(pose(translation=(0.9, 0.0, 0.0)) @ truth), truth]).astype(np.float32)
    judged = judge_poses(a.prepared, b.prepared, poses, num_points=None)
    # As if the wrong pose had agreed a little better.
    judged = judged._replace(hits=np.asarray([0.9, 0.8]), conflicts=np.zeros(2))
    tried = Tried(poses, judged.strength())
    ranked = weigh_rivals(a, b, Leaders(poses, judged, ("guess", "exhaustive"), tried), BOUNDS)
    np.testing.assert_array_equal(ranked.poses[0], poses[1])
    assert ranked.sources == ("exhaustive", "guess")
    assert ranked.judgement.changed[0] < ranked.judgement.changed[1]
    assert ranked.judgement.pieces[0] < ranked.judgement.pieces[1]
    assert ranked.judgement.shared[0] == pytest.approx(
        2 * a.prepared.num_points * a.prepared.grid.voxel_size**2, rel=0.1
    )


def test_without_free_space_nobody_looks(pair):
    a, b, truth = pair
    poses = truth[None].astype(np.float32)
    judged = judge_poses(a.prepared, b.prepared, poses, num_points=256)._replace(has_free_space=False)
    ranked = weigh_rivals(a, b, Leaders(poses, judged, ("guess",), Tried(poses, judged.strength())), BOUNDS)
    np.testing.assert_array_equal(ranked.judgement.shared, 0.0)
