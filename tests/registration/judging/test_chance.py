"""What chance reaches in a pair, on poses written by hand."""

import numpy as np
import pytest

from small_worlds import pose
from voxjax.registration.judging.chance import chance_level
from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.leaders import Leaders, Tried
from voxjax.registration.judging.settings import VerdictConfig

BOUNDS = VerdictConfig()


def leaders(found, tried, *, has_free_space=True):
    """Leaders and tried poses: each a place along x [m] and a strength."""
    (places, scores), (others, strengths) = (np.asarray(each, np.float64).T for each in (found, tried))
    one, information = np.ones(len(scores)), np.tile(np.eye(3) / 3, (len(scores), 1, 1))
    nothing = 0 * one
    judged = Judgement(
        scores, nothing, nothing, information, nothing, nothing, nothing, one, one, one, 6.0, has_free_space
    )
    poses, all_poses = (
        np.stack([pose(translation=(x, 0.0, 0.0)) for x in each]).astype(np.float32)
        for each in (places, others)
    )
    return Leaders(poses, judged, ("exhaustive",) * len(poses), Tried(all_poses, strengths))


@pytest.mark.parametrize(
    ("found", "tried", "expected"),
    [
        # The best of the others, wherever it is from.
        ([(0, 0.6), (9, 0.1)], [(20, 0.05), (30, 0.08)], 0.1),
        ([(0, 0.6), (9, 0.1)], [(20, 0.05), (30, 0.15)], 0.15),
        # What lies near the best pose is that pose, before its last refinement.
        ([(0, 0.6), (9, 0.1)], [(0.5, 0.25), (30, 0.05)], 0.1),
        # Rivals are no chance, whether they are among the leaders or were only tried.
        ([(0, 0.6), (9, 0.5)], [(20, 0.4), (9.5, 0.2), (30, 0.07)], 0.07),
        # Where nothing else was tried, chance is not known to be smaller than the floor.
        ([(0, 0.6)], [(0, 0.5)], BOUNDS.min_chance),
    ],
)
def test_chance_is_the_best_pose_that_is_no_rival(pair, found, tried, expected):
    level = chance_level(pair[1].prepared, leaders(found, tried), BOUNDS)
    assert level == pytest.approx(expected)


def test_without_free_space_the_floor_is_lower(pair):
    one = leaders([(0, 0.6)], [(0, 0.5)], has_free_space=False)
    assert chance_level(pair[1].prepared, one, BOUNDS) == BOUNDS.min_exact_chance
