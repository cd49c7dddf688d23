"""Proposals of each source, and what is admitted of them."""

import numpy as np
import pytest

from small_worlds import pose
from voxjax.metrics import pose_error
from voxjax.registration.hypotheses.pose_range import PoseRange
from voxjax.registration.hypotheses.proposals import (
    Proposals,
    admit,
    propose_corner_frames,
    propose_exhaustively,
    propose_from_descriptors,
    propose_guess,
    propose_subgraphs,
)
from voxjax.registration.hypotheses.settings import (
    DescriptorConfig,
    ExhaustiveConfig,
    FrameConfig,
    RotationConfig,
    SourceConfig,
    SubgraphConfig,
)


def test_sources_are_joined_in_order_and_what_cannot_be_is_left_out():
    upright = Proposals(
        np.stack([pose(yaw=9.0), pose(tilt=40.0)]), ("subgraph", "descriptor"), 7, {"size": 3}
    )
    found = admit([propose_guess(pose(yaw=1.0)), upright], PoseRange(np.zeros(3, np.float32), 8.0))
    assert found.sources == ("guess", "subgraph")
    assert found.poses.dtype == np.float32
    assert found.num_found == 7
    assert found.counts == {"size": 3}


def test_nothing_proposed_is_no_pose():
    found = admit([], PoseRange(np.zeros(3, np.float32)))
    assert found.poses.shape == (0, 4, 4)
    assert (found.sources, found.num_found, found.counts) == ((), 0, {})


def best_error(found, truth, centroid):
    return min(pose_error(T, truth, centroid).metres for T in found.poses)


def test_each_source_proposes_the_truth_and_counts_what_it_found(pair):
    a, b, truth = pair
    centroid = np.asarray(b.prepared.centroid)
    anywhere = PoseRange(centroid)
    few = FrameConfig(max_poses=20)
    exhaustive = propose_exhaustively(
        a,
        b,
        SourceConfig(num_peaks=8),
        max_lean=None,
        conflict_weight=3.0,
        rotation=RotationConfig(),
        exhaustive=ExhaustiveConfig(),
    )
    frames = propose_corner_frames(a, b, few, pose_range=anywhere, conflict_weight=3.0)
    subgraphs = propose_subgraphs(a, b, SourceConfig(), SubgraphConfig())
    for found in (exhaustive, frames, subgraphs):
        assert best_error(found, truth, centroid) < 0.5
        assert len(found.sources) == len(found.poses) <= found.num_found
    assert len(frames.poses) <= 20 < frames.num_found
    assert set(frames.sources) <= {"corner", "virtual corner"}
    assert frames.counts["num_corners_a"] > 0
    assert subgraphs.counts["clique_size"] >= 3
    assert exhaustive.counts["num_rotations"] * 8 == exhaustive.num_found


def test_a_map_of_few_points_is_described_at_the_level_of_one_of_many(pair, monkeypatch):
    a, b, truth = pair
    for first in (0, 1, 2):
        # As a map of more points would have it; it is a property of map a alone.
        monkeypatch.setattr(a.late, "_finest_level", first)
        found = propose_from_descriptors(a, b, DescriptorConfig(), max_poses=4)
        spacings = [
            [level.spacing for level in each.late.descriptors(use_free_space=True, finest=first).levels]
            for each in (a, b)
        ]
        assert spacings[0] == spacings[1]
        assert spacings[0][0] == pytest.approx(0.3 * 1.6**first)
        assert best_error(found, truth, np.asarray(b.prepared.centroid)) < 0.3 * 1.6**first


def test_frames_outside_the_range_are_not_even_ranked(pair):
    a, b, _ = pair
    nowhere = PoseRange(np.asarray(b.prepared.centroid), None, pose(translation=(99.0, 0.0, 0.0)), 0.1, 0.1)
    found = propose_corner_frames(a, b, FrameConfig(), pose_range=nowhere, conflict_weight=3.0)
    assert len(found.poses) == found.num_found == 0
    assert found.counts["num_corners_b"] > 0
