"""The coarse search as a source of hypotheses: aligned poses near the truth, among those that can be."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax.metrics import pose_error
from voxjax.pipeline.coarse import coarse_proposals
from voxjax.pipeline.config import Config
from voxjax.registration.hypotheses.map_features import map_features
from voxjax.registration.hypotheses.pose_range import PoseRange

T_MAP_WORLD = pose(yaw=40.0, translation=(2.0, -1.0, 0.5))


@pytest.fixture(scope="module")
def maps():
    return map_features(draw_map(), max_virtual=8), map_features(draw_map(T_MAP_WORLD), max_virtual=8)


def test_poses_are_aligned_before_anything_ranks_them(maps):
    a, b = maps
    centroid = np.asarray(b.prepared.centroid)
    found = coarse_proposals(a, b, Config(), pose_range=PoseRange(centroid))
    assert set(found.sources) == {"exhaustive"}
    assert found.num_found == len(found.poses) <= Config().cause.num_leaders
    errors = [pose_error(T, np.linalg.inv(T_MAP_WORLD), centroid) for T in found.poses]
    # The cells of the search are 0.9 m wide.
    assert min(error.metres for error in errors) < 0.1


def test_only_poses_that_can_be_are_proposed_and_a_guess_comes_first(maps):
    a, b = maps
    centroid, truth = np.asarray(b.prepared.centroid), np.linalg.inv(T_MAP_WORLD).astype(np.float32)
    upright = PoseRange(centroid, max_lean=8.0)
    found = coarse_proposals(a, b, Config(), pose_range=upright)
    assert len(found.poses)
    assert (found.poses[:, 2, 2] > np.cos(np.radians(8.0))).all()
    guessed = coarse_proposals(a, b, Config(), pose_range=upright, guess=truth)
    error = pose_error(guessed.poses[0], truth, centroid)
    assert error.metres < 0.1
    away = PoseRange(centroid, guess=truth @ pose(translation=(50.0, 0.0, 0.0)), metres=1.0)
    assert len(coarse_proposals(a, b, Config(), pose_range=away).poses) == 0
