import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.features.cluster import cluster_corners, suppress_duplicates


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 60), st.floats(0.05, 0.8))
def test_every_corner_is_near_a_chosen_one_that_is_no_worse_and_the_chosen_are_apart(seed, n, radius):
    rng = np.random.default_rng(seed)
    position, quality = rng.random((n, 3)), rng.random(n)
    cluster, chosen = cluster_corners(position, quality, radius=radius)
    assert len(cluster) == n
    if n:
        own = chosen[cluster]
        assert (np.linalg.norm(position - position[own], axis=1) <= radius + 1e-12).all()
        assert (quality[own] >= quality).all()
        gap = np.linalg.norm(position[chosen][:, None] - position[chosen], axis=2)
        assert (gap[~np.eye(len(chosen), dtype=bool)] > radius).all()
        assert (np.diff(quality[chosen]) <= 0).all()


def test_ties_go_to_the_first():
    cluster, chosen = cluster_corners(np.zeros((3, 3)), np.ones(3), radius=0.1)
    assert cluster.tolist() == [0, 0, 0]
    assert chosen.tolist() == [0]


def test_corners_of_other_rooms_or_kinds_at_the_same_place_are_kept():
    frame = np.eye(3)
    normals = np.stack([frame, np.roll(frame, 1, axis=0), frame * [1, -1, 1], frame])
    position = np.zeros((4, 3))
    kind = np.asarray([0, 0, 0, 3], np.int32)
    keep = suppress_duplicates(position, normals, kind, np.asarray([1.0, 2.0, 3.0, 4.0]), radius=0.2)
    # Row 1 lists the normals of row 0 in another order and is heavier.
    assert keep.tolist() == [3, 2, 1]


def test_far_corners_are_no_duplicates():
    position = np.asarray([[0.0, 0, 0], [0.3, 0, 0]])
    normals = np.stack([np.eye(3)] * 2)
    kind = np.zeros(2, np.int32)
    assert len(suppress_duplicates(position, normals, kind, np.ones(2), radius=0.2)) == 2
    assert len(suppress_duplicates(position, normals, kind, np.ones(2), radius=0.4)) == 1
