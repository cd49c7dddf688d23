import numpy as np
import pytest

from voxjax.io.leaves import NUM_KEYS, Leaves, leaf_map, pieces

FREE, OCCUPIED = np.uint8(1), np.uint8(2)


def wide_and_narrow():
    """A free leaf 8 wide at (64, 64, 64), and two occupied voxels beside it."""
    wide = Leaves(13, np.full((1, 3), 64, np.int32), np.array([1], np.uint8))
    narrow = Leaves(16, np.array([[72, 64, 64], [60, 70, 71]], np.int32), np.array([2, 2], np.uint8))
    return leaf_map(
        [Leaves(12, np.zeros((0, 3), np.int32), np.zeros(0, np.uint8)), wide, narrow], 0.5, has_log_odds=False
    )


def test_a_map_is_as_large_as_its_leaves():
    leaves = wide_and_narrow()
    assert [level.width for level in leaves.levels] == [8, 1]
    assert leaves.low.tolist() == [60, 64, 64]
    assert leaves.shape == (13, 8, 8)
    assert leaves.num_leaves == 3
    assert leaves.num_bytes == sum(level.key.nbytes + level.value.nbytes for level in leaves.levels)
    low, high = leaves.extent
    assert low.tolist() == [(60 - 32768) * 0.5] + [(64 - 32768) * 0.5] * 2
    assert (high - low).tolist() == [6.5, 4.0, 4.0]


def test_voxels_are_counted_inside_of_wide_leaves():
    assert (wide_and_narrow().count(FREE), wide_and_narrow().count(OCCUPIED)) == (512, 2)
    root = leaf_map([Leaves(0, np.zeros((1, 3), np.int32), np.ones(1, np.float32))], 0.1, has_log_odds=True)
    assert root.count(OCCUPIED) == NUM_KEYS**3
    assert root.shape == (NUM_KEYS,) * 3
    assert root.num_bytes == 16


def test_log_odds_of_zero_are_occupied():
    level = Leaves(16, np.zeros((3, 3), np.int32), np.array([-0.5, 0.0, 0.5], np.float32))
    assert level.states().tolist() == [1, 2, 2]


def test_a_window_cuts_wide_leaves():
    cut = wide_and_narrow().cut(np.array([66, 0, 65]), np.array([72, 70, 100]))
    assert (cut.low.tolist(), cut.high.tolist()) == ([66, 64, 65], [72, 70, 72])
    assert cut.count(FREE) == 6 * 6 * 7
    assert cut.count(OCCUPIED) == 0
    again = cut.cut(np.zeros(3, np.int64), np.array([70, 70, 70]))
    assert again.count(FREE) == 4 * 6 * 5


@pytest.mark.parametrize(
    "window", [((0, 0, 0), (60, 70, 70)), ((66, 66, 66), (66, 70, 70)), ((69, 69, 69), (67, 70, 70))]
)
def test_nothing_is_left_in_a_window_without_voxels(window):
    cut = wide_and_narrow().cut(*np.array(window))
    assert cut.levels == []
    assert cut.shape == (0, 0, 0)
    assert cut.count(FREE) == 0


def test_a_crop_takes_the_voxels_whose_centres_it_holds():
    at = (64 - 32768) * 0.5
    cut = wide_and_narrow().within((np.full(3, at + 0.25), np.full(3, at + 0.8)))
    assert (cut.low.tolist(), cut.shape) == ([64, 64, 64], (2, 2, 2))


def test_pieces_hold_all_leaves_in_their_order():
    key = np.arange(3 * 70_000, dtype=np.int32).reshape(-1, 3)
    level = Leaves(16, key, np.ones(len(key), np.uint8))
    parts = list(pieces(level))
    assert len(parts) > 2
    np.testing.assert_array_equal(np.concatenate([part.key for part in parts]), key)
