"""What a merge says of itself in one sentence."""

import numpy as np

from fake_register import registration
from voxjax.pipeline.merged import Merge


def merge_of(status, poses, pairs=()):
    return Merge(
        grid=None,
        poses=tuple(poses),
        pairs=tuple(pairs),
        status=status,
        loops=(),
        seconds={},
        late=(None,) * len(poses),
        middles=(np.zeros(3),) * len(poses),
    )


def test_the_reason_names_what_was_left_out():
    pose = np.eye(4, dtype=np.float32)
    assert merge_of("merged", [pose] * 3).reason == "All 3 maps were merged."
    assert merge_of("partial", [pose, None, pose, None]).reason == "2 of 4 maps were merged; left out: 1, 3."


def test_without_overlap_the_pair_that_came_closest_speaks():
    assert merge_of("no_overlap", [None, None]).reason == "No two maps fit together."
    near = registration(np.eye(4), verdict="ambiguous", confidence=0.4)
    far = registration(np.eye(4), verdict="no_overlap", confidence=0.1)
    assert merge_of("no_overlap", [None] * 3, [(0, 1, far), (0, 2, near)]).reason == near.reason


def test_it_prints_on_one_line():
    pose = np.eye(4, dtype=np.float32)
    pairs = [(0, 1, registration(pose)), (0, 2, registration(pose, verdict="no_overlap"))]
    assert repr(merge_of("partial", [pose, pose, None], pairs)) == (
        "Merge(partial, pairs: 1 accepted, 1 no_overlap, grid=None: 2 of 3 maps were merged; left out: 2.)"
    )
