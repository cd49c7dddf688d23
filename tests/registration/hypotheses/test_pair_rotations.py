"""Rotations of a pair: those of the normals, found once."""

import numpy as np

from voxjax.registration.hypotheses.pair_rotations import rotations_of_pair
from voxjax.registration.hypotheses.settings import RotationConfig


def test_one_of_the_rotations_is_the_true_one_and_all_are_kept(pair):
    a, b, truth = pair
    options = {"max_rotations": 48, "settings": RotationConfig()}
    found = rotations_of_pair(a, b, max_lean=None, **options)
    cosine = (np.einsum("kij,ij->k", found, truth[:3, :3]) - 1.0) / 2.0
    assert np.degrees(np.arccos(np.clip(cosine.max(), -1.0, 1.0))) < 2.0
    assert rotations_of_pair(a, b, max_lean=None, **options) is found
    # Frames that lean against each other by 12 degrees are not those of a robot that drives on floors.
    upright = rotations_of_pair(a, b, max_lean=8.0, **options)
    assert len(upright) < len(found)
