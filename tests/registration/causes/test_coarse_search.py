"""The coarse search begins with the truth, at the scale that is nearest to the right one."""

import dataclasses

import numpy as np

from voxjax.metrics import pose_error
from voxjax.registration.causes.coarse_search import coarse_starts
from voxjax.registration.causes.settings import CauseConfig
from voxjax.registration.hypotheses.changed_features import scaled_features
from voxjax.registration.hypotheses.settings import EvidenceConfig, RotationConfig, SourceConfig

OPTIONS = {
    "settings": CauseConfig(),
    "source": SourceConfig(),
    "rotation": RotationConfig(),
    "evidence": EvidenceConfig(),
}


def test_the_best_start_is_near_the_truth_at_the_nearest_scale(pair):
    a, b, truth = pair
    starts = coarse_starts(a, scaled_features(b, 1.06), (0.93, 1.0, 1.07), num_starts=5, **OPTIONS)
    assert len(starts) == 5
    assert starts[0].scale == 0.93
    error = pose_error(starts[0].T_a_b, truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 8.0
    assert error.metres < 1.0


def test_a_map_without_directions_has_no_start(pair):
    a, b, _ = pair
    flat = dataclasses.replace(b, directions=b.directions[:0], shares=b.shares[:0])
    assert coarse_starts(a, flat, (1.0,), num_starts=5, **OPTIONS) == []
