import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax import InputError
from voxjax.ops.descriptors.tiles import GROUP, LEAF, near_tiles, point_tree


def listed_pairs(near, count):
    """All pairs of rows that the items bring together, as one number each."""
    mine = near.rows.reshape(-1, 2 * LEAF)[near.own]
    theirs = near.rows[near.others].reshape(len(near.own), -1)
    a, b = np.broadcast_arrays(mine[:, :, None], theirs[:, None, :])
    is_pair = (a < count) & (b < count)
    return (a.astype(np.int64) * count + b)[is_pair]


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 300), st.floats(0.05, 3.0), st.integers(0, 2**32 - 1))
def test_every_near_pair_comes_up_once(count, radius, seed):
    rng = np.random.default_rng(seed)
    points = (rng.normal(size=(count, 3)) * rng.choice([0.0, 0.1, 1.0, 5.0], 3)).astype(np.float32)
    pairs = listed_pairs(near_tiles(point_tree(points), radius), count)
    assert len(np.unique(pairs)) == len(pairs)
    distance = np.linalg.norm(points[:, None].astype(float) - points[None], axis=2)
    expected = np.flatnonzero(distance <= radius)
    assert np.isin(expected, pairs).all()


def test_tiles_far_apart_do_not_come_up():
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 20, (4000, 3)).astype(np.float32)
    near = near_tiles(point_tree(points), 2.0)
    pairs = listed_pairs(near, len(points))
    a, b = np.divmod(pairs, len(points))
    distance = np.linalg.norm(points[a] - points[b], axis=1)
    assert distance.max() < 12.0
    assert np.mean(distance <= 2.0) > 0.04  # a solid: surfaces have four times as many
    assert near.others.shape == (len(near.own), GROUP)


def test_all_rows_have_a_place_and_the_last_half_tile_is_empty():
    for count in (0, 1, 7, 8, 9, 16, 17, 128, 1000):
        tree = point_tree(np.random.default_rng(count).normal(size=(count, 3)))
        rows = tree.rows[tree.rows < count]
        np.testing.assert_array_equal(np.sort(rows), np.arange(count))
        assert (tree.rows[-1] == count).all()
        near = near_tiles(tree, 0.5)
        assert (near.own.size == 0) == (count == 0)
        assert (np.diff(near.own) >= 0).all()
        # Of the places without points only so many are left that the last half tile is one.
        np.testing.assert_array_equal(np.sort(near.rows[near.rows < count]), np.arange(count))
        assert (near.rows[-1] == count).all()
        assert near.rows.size <= count + 2 * 2 * LEAF


def test_unusable_points_and_radii_are_refused():
    with pytest.raises(InputError, match="points must have finite coordinates"):
        point_tree(np.array([[0.0, np.nan, 0.0]]))
    with pytest.raises(InputError, match="radius must be a finite number above 0"):
        near_tiles(point_tree(np.zeros((3, 3))), 0.0)
