"""Looking at places where three planes meet: which kinds of corner are there, and where there is none."""

import numpy as np

from block_maps import turned_map, ways
from corner_rooms import SIZE, TURNS, room_grid
from oracles import box_room
from voxjax.features.observed import observe_corners


def test_true_corners_are_seen_with_their_kind_and_signs():
    turn = TURNS["straight"]
    grid, shift = room_grid(turn)
    position, normals, convexity = box_room.true_corners()
    place = position * SIZE @ turn.T + shift
    found = observe_corners(grid, place, normals @ turn.T)
    for row, kind in enumerate(convexity):
        at = (found.row == row) & (found.convexity == kind)
        assert at.sum() == 1
        # The rows may come in another order, with the signs that point into free space.
        product = found.normals[at][0] @ (normals[row] @ turn.T).T
        assert np.allclose(np.sort(product.max(axis=1)), 1.0, atol=1e-4)
    assert (found.coverage > 0.4).all()


def test_the_middle_of_a_wall_is_no_corner():
    grid, shift = room_grid(TURNS["straight"])
    position, _, _ = box_room.true_corners()
    between = (position[:1] + position[1:2]) / 2 * SIZE + shift
    assert len(observe_corners(grid, between, np.eye(3)[None]).row) == 0


def test_corners_are_seen_in_tiles_and_blocks_as_in_the_whole_box(monkeypatch):
    grid, rng = turned_map(), np.random.default_rng(0)
    low, high = grid.extent
    # Some points lie beyond the box, whose patches reach into it.
    position = rng.uniform(low - 0.6, high + 0.6, (3000, 3))
    normals = np.linalg.qr(rng.normal(size=(3000, 3, 3)))[0]
    # Low bounds: nearly everything counts as some corner, with the share of its faces that was seen.
    bounds = {"min_seen": 0.02, "max_beyond": 0.9}
    first, *others = (observe_corners(each, position, normals, **bounds) for each in ways(grid, monkeypatch))
    assert len(np.unique(first.row)) > 300
    found = position[first.row]
    assert ((found < low) | (found > high)).any()
    for other in others:
        for one, two in zip(first, other, strict=True):
            np.testing.assert_array_equal(one, two)
