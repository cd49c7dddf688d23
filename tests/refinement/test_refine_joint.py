import numpy as np
import pytest

import voxjax as vx
from oracles.motions import pose_error
from oracles.rooms import VOXEL
from voxjax.refinement.refine_joint import refine_joint

POINTS = 1024


LOOP = [(0, 1), (1, 2), (3, 2), (0, 3)]


def errors(poses, truth, centroids, numbers=range(4)):
    """Degrees and metres of each map."""
    return np.array([pose_error(poses[n], truth[n], centroids[n]) for n in numbers])


def test_a_loop_ends_nearer_to_the_truth_than_a_chain_of_pairs(team):
    maps, truth, starts, centroids = team
    found = refine_joint(maps, starts, pairs=LOOP, num_points=POINTS)
    assert found.result == vx.RESULTS.successful
    assert found.pairs == tuple(LOOP)
    assert found.cost_after < found.cost_before
    chained = [starts[0]]
    for a in range(3):
        start = np.linalg.inv(starts[a]) @ starts[a + 1]
        T_a_b = vx.refine(maps[a], maps[a + 1], start, num_points=POINTS, both_ways=True).T_a_b
        chained.append(chained[-1] @ np.asarray(T_a_b, np.float64))
    joint, chain = (errors(poses, truth, centroids) for poses in (found.poses, chained))
    # The last map is drawn in a frame in which its voxels lean by about so much: pairs find the same.
    assert joint[:, 0].max() < 0.5
    assert joint[:, 1].max() < 0.1 * VOXEL
    assert joint[1:, 0].mean() <= chain[1:, 0].mean()
    assert joint[1:, 1].mean() <= chain[1:, 1].mean()
    assert np.isfinite(found.covariance).all()
    sigma = np.sqrt(np.trace(found.covariance[1:4, :3, :3], axis1=1, axis2=2))
    assert (joint[1:, 1] < 3 * sigma).all()
    assert (sigma < VOXEL).all()


def test_the_order_of_maps_and_pairs_does_not_matter(team):
    maps, _, starts, centroids = team
    found = refine_joint(maps, starts, pairs=LOOP, num_points=POINTS)
    order = [3, 1, 4, 0, 2]
    place = np.argsort(order)
    pairs = [(int(place[b]), int(place[a])) for a, b in LOOP[::-1]]
    other = refine_joint(
        [maps[n] for n in order],
        [starts[n] for n in order],
        pairs=pairs,
        anchor=int(place[0]),
        num_points=POINTS,
    )
    gaps = errors([other.poses[place[n]] for n in range(5)], found.poses, centroids)
    # Points keep the matches that they found last, which a step of rounding may change.
    assert gaps[:, 0].max() < 0.05
    assert gaps[:, 1].max() < 0.03 * VOXEL


def test_two_maps_equal_a_pair_and_what_is_held_stays_bit_for_bit(team):
    maps, _, starts, centroids = team
    found = refine_joint(maps, starts, pairs=[(0, 1), (2, 3)], anchor=1, num_points=POINTS)
    assert found.held == (1, 2, 4)
    assert found.unpaired == (4,)
    np.testing.assert_array_equal(np.asarray(found.poses)[[1, 2, 4]], np.asarray(starts)[[1, 2, 4]])
    np.testing.assert_array_equal(np.asarray(found.covariance)[[1, 2, 4]], 0.0)
    for a, b in found.pairs:
        start = np.linalg.inv(starts[a]) @ starts[b]
        pair = vx.refine(maps[a], maps[b], start, num_points=POINTS, both_ways=True).T_a_b
        joint = np.linalg.inv(np.asarray(found.poses[a], np.float64)) @ np.asarray(found.poses[b], np.float64)
        angle, gap = pose_error(joint, pair, centroids[b])
        # Both pairs share one damping here, so that other matches may be held at the end.
        assert angle < 0.08
        assert gap < 0.03 * VOXEL


def test_a_pair_without_overlap_changes_nothing_and_is_finite(team):
    maps, _, starts, _ = team
    far = [T.copy() for T in starts]
    far[3][0, 3] += 100.0
    found = refine_joint(maps, far, pairs=[(0, 1), (2, 3)], num_points=POINTS)
    assert found.result == vx.RESULTS.degenerate
    assert np.isfinite(found.poses).all()
    assert np.isfinite(found.covariance).all()
    np.testing.assert_allclose(found.poses[3], far[3], atol=1e-4)
    assert np.abs(np.asarray(found.poses[1]) - starts[1]).max() > 1e-3


def test_nothing_to_refine_is_an_outcome(team):
    maps, _, starts, _ = team
    empty = vx.VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3, np.float32), VOXEL)
    alone = refine_joint([maps[0], maps[4]], [starts[0], starts[4]])
    assert alone.result == vx.RESULTS.no_overlap
    assert alone.unpaired == alone.held == (0, 1)
    np.testing.assert_array_equal(alone.poses, np.asarray([starts[0], starts[4]]))
    assert refine_joint([maps[0], empty], starts[:2], pairs=[(0, 1)]).result == vx.RESULTS.empty_map


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"poses": [np.eye(4)]}, "grids and poses"),
        ({"poses": [np.eye(4), np.ones((4, 4))]}, r"poses\[1\]"),
        ({"anchor": 2}, "anchor"),
        ({"pairs": [(0, 2)]}, "pairs"),
        ({"pairs": [(1, 1)]}, "pairs"),
        ({"pairs": [(0, 1), (1, 0)]}, "pairs"),
        ({"num_points": 0}, "num_points"),
        ({"num_points": 10**12}, "num_points must be at most 10000000, got 1000000000000"),
        ({"max_distance": 0.0}, "max_distance"),
    ],
)
def test_bad_input_is_one_sentence(team, changes, word):
    with pytest.raises(vx.InputError, match=word):
        refine_joint(**({"grids": team[0][:2], "poses": [np.eye(4), np.eye(4)]} | changes))
