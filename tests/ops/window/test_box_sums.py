"""The three forms of window sums, and the margin around the grid, against shifted copies."""

import numpy as np
import pytest

from oracles import sliding_window
from voxjax.ops.window.box_sums import packed, separable, summed_area


@pytest.mark.parametrize("form", [separable, packed, summed_area])
@pytest.mark.parametrize(("size", "margin"), [(1, 0), (7, 0), (5, 3), (15, 1)])
def test_sums_equal_shifted_copies_also_around_the_grid(form, size, margin):
    occupied = np.random.default_rng(size).random((6, 5, 9)) < 0.6
    sums = form(occupied, size, margin)
    assert sums.dtype == np.uint16
    expected = sliding_window.window_count(np.pad(occupied, margin), size)
    np.testing.assert_array_equal(np.asarray(sums), expected)
