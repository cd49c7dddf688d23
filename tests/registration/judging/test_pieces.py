"""Voxels that hang together, and where poses put them."""

import numpy as np

from small_worlds import pose
from voxjax.registration.judging.pieces import cells_of_points, pieces_of


def test_pieces_in_a_large_box_are_those_in_a_small_one():
    rng = np.random.default_rng(0)
    index = np.argwhere(rng.random((12, 9, 20)) < 0.1) - 5
    whole, apart = pieces_of(index), pieces_of(index, most=1)
    # Numbers differ, pieces do not.
    assert len(np.unique(whole)) == len(np.unique(apart)) == len(np.unique([whole, apart], axis=1).T) > 10
    spread_out = np.concatenate([index, index + 3_000_000])
    assert len(np.unique(pieces_of(spread_out))) == 2 * len(np.unique(whole))


def test_cells_under_a_pose_hold_the_voxels_that_lie_there(pair):
    a, b, truth = pair
    points = np.asarray(b.prepared.points)[: b.prepared.num_points]
    for T in (truth, pose(translation=(100.0, 0.0, 0.0)) @ truth):
        cell, is_inside = cells_of_points(a.prepared, points, T)
        moved = points.astype(np.float64) @ T[:3, :3].T + T[:3, 3]
        index = np.floor((moved - a.prepared.grid.origin) / a.prepared.grid.voxel_size)
        expected = ((index >= 0) & (index < a.prepared.grid.shape)).all(axis=1)
        # A place on the face of two voxels may round either way.
        assert (is_inside == expected).mean() > 0.999
        states = np.asarray(a.prepared.states)[cell][is_inside & expected]
        known = a.prepared.grid.states[tuple(index[is_inside & expected].astype(int).T)]
        assert (states == known).mean() > 0.995 if len(states) else not expected.any()
