"""Kernels over tiles against the same kernels over the whole box."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax.ops.blocks.over_tiles import over_tiles

SHAPE = (150, 70, 130)


def sums_around(states, index, halo):
    padded = np.pad(states.astype(np.int64), halo)
    width = 2 * halo + 1
    return np.asarray([padded[x : x + width, y : y + width, z : z + width].sum() for x, y, z in index])


def both(states, index, *, halo, most):
    """A tree of sums of the surroundings and of the places themselves, and the windows that were looked at."""
    windows = []

    def window(low, high):
        windows.append((low, high))
        return states[tuple(map(slice, low, high))]

    def kernel(values, low, rows):
        local = index[rows] - low
        return {"sum": sums_around(values, local, halo), "place": local + low}

    return over_tiles(kernel, window, index, states.shape, halo=halo, most=most), windows


@pytest.mark.parametrize("order", ["sorted", "mixed"])
def test_rows_are_those_of_the_whole_box_in_their_order(order):
    states, rng = random_boxes(SHAPE, seed=3), np.random.default_rng(1)
    index = np.argwhere(states == 2)[::37]
    if order == "mixed":
        index = rng.permutation(index)
    whole, (only,) = both(states, index, halo=3, most=1 << 24)
    np.testing.assert_array_equal(only, [(0, 0, 0), SHAPE])
    tiled, windows = both(states, index, halo=3, most=1 << 18)
    assert len(windows) > 4
    np.testing.assert_array_equal(tiled["sum"], whole["sum"])
    np.testing.assert_array_equal(tiled["place"], index)


def test_a_window_is_no_larger_than_its_voxels_ask_for():
    index = np.array([[3, 3, 3], [5, 4, 4], [148, 69, 129]])
    found, windows = both(np.ones(SHAPE, np.uint8), index, halo=2, most=1 << 18)
    np.testing.assert_array_equal(windows, [[(1, 1, 1), (8, 7, 7)], [(146, 67, 127), SHAPE]])
    np.testing.assert_array_equal(found["sum"], [125, 125, 36])


def test_a_list_without_voxels_gives_arrays_without_rows():
    found, _ = both(np.ones(SHAPE, np.uint8), np.zeros((0, 3), np.int64), halo=2, most=1 << 18)
    assert found["place"].shape == (0, 3)
    assert found["sum"].shape == (0,)
