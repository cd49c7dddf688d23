"""The small building in two frames, with its features, for all tests of registration."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax.registration.hypotheses.exhaustive import exhaustive_hypotheses, upright_frame
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.hypotheses.rotations import rotation_hypotheses


@pytest.fixture(scope="session")
def T_map_world():
    """The frame of the second map."""
    return pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))


@pytest.fixture(scope="session")
def pair(T_map_world):
    """Features of both maps, and the true pose of the second in the first."""
    a = map_features(draw_map(), max_virtual=64)
    b = map_features(draw_map(T_map_world), max_virtual=64)
    return a, b, np.linalg.inv(T_map_world)


@pytest.fixture(scope="session")
def exhaustive():
    """Poses and coarse scores of the exhaustive search between the features of two maps."""

    def search(a, b):
        rotations, _ = rotation_hypotheses(a.normals, b.normals, a.directions, b.directions, is_signed=True)
        return exhaustive_hypotheses(
            a.prepared,
            b.prepared,
            rotations,
            upright_frame(a.directions, a.shares),
            conflict_weight=3.0,
            num_peaks=8,
        )

    return search
