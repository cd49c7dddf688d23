"""Which sources each round asks."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at
from voxjax.pipeline.hypotheses import first_hypotheses, other_hypotheses
from voxjax.pipeline.stage_times import Stages
from voxjax.registration.hypotheses.pose_range import PoseRange

ALL = {"corners", "subgraph", "descriptors", "exhaustive"}


@pytest.fixture(scope="module")
def features():
    grid = draw_map()
    return features_at(grid, voxel_size=grid.voxel_size)


def ask(asked, features, *, guess=None, **source):
    config = config_from({"source": {name: name in asked for name in ALL} | source})
    heard = []
    stages = Stages(heard.append)
    pose_range = PoseRange(np.asarray(features.prepared.centroid))
    options = {"pose_range": pose_range, "stages": stages}
    first = first_hypotheses(features, features, config, guess=guess, **options)
    others = other_hypotheses(features, features, config, **options)
    assert heard == ["hypotheses", "hypotheses"]
    return first, others, stages.seconds


def test_no_source_and_no_guess_propose_nothing(features):
    first, others, seconds = ask(set(), features)
    assert len(first.poses) == len(others.poses) == 0
    assert seconds == {}


def test_the_first_round_holds_the_guess_and_the_exhaustive_search(features):
    guess = pose(yaw=5.0).astype(np.float32)
    first, others, seconds = ask({"exhaustive"}, features, guess=guess, num_peaks=2, max_rotations=4)
    assert first.sources == ("guess", *["exhaustive"] * 8)
    np.testing.assert_array_equal(first.poses[0], guess)
    assert len(others.poses) == 0
    assert set(seconds) == {"exhaustive search"}


@pytest.mark.parametrize(
    ("source", "stage", "names"),
    [
        ("corners", "corner frames", {"corner", "virtual corner"}),
        ("subgraph", "common subgraph", {"subgraph"}),
        ("descriptors", "descriptors", {"descriptor"}),
    ],
)
def test_the_second_round_asks_the_other_sources(features, source, stage, names):
    first, others, seconds = ask({source}, features)
    assert len(first.poses) == 0
    assert set(others.sources) <= names
    assert len(others.poses) > 0
    assert set(seconds) == {stage}
