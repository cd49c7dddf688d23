"""Guesses of the pose, and the poses that can be around them."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax import InputError
from voxjax.pipeline.features import features_at
from voxjax.pipeline.guesses import checked_guess, range_around

GUESS = pose(yaw=30.0, translation=(1.0, 2.0, 0.0))


def test_a_guess_is_a_rigid_transform_or_none():
    assert checked_guess(None, None) is None
    found = checked_guess(GUESS.tolist(), (1.0, 0.2))
    assert found is not None
    np.testing.assert_allclose(found, GUESS)


@pytest.mark.parametrize(
    ("guess", "uncertainty", "words"),
    [
        (2.0 * GUESS, None, "init_guess"),
        (None, (1.0, 0.2), "guess_uncertainty needs an init_guess"),
        (GUESS, (1.0, -0.2), r"guess_uncertainty\[1\]"),
    ],
)
def test_guesses_that_cannot_be_used_are_refused(guess, uncertainty, words):
    with pytest.raises(InputError, match=words):
        checked_guess(guess, uncertainty)


def test_poses_can_be_near_the_guess_where_it_has_an_uncertainty():
    b = features_at(draw_map(), voxel_size=0.15)
    near, away = GUESS, pose(yaw=30.0, translation=(6.0, 2.0, 0.0))
    poses = np.stack([near, away]).astype(np.float32)
    assert range_around(b, None, GUESS, None).admits(poses).all()
    np.testing.assert_array_equal(range_around(b, None, GUESS, (1.0, 0.2)).admits(poses), [True, False])
    leaning = pose(tilt=40.0)[None].astype(np.float32)
    assert not range_around(b, 8.0, None, None).admits(leaning).any()
