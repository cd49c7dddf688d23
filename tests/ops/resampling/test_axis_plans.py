"""Plans of axes against their definition, and the largest of each cell against a loop."""

import numpy as np
import pytest

from voxjax.ops.resampling.axis_plans import AxisPlan, plan_axis, take_largest


@pytest.mark.parametrize("ratio", [0.2, 0.37, 0.99])
@pytest.mark.parametrize("base", [0.0, -13.4, 7.5])
def test_cells_begin_with_the_first_voxel_whose_centre_they_hold(ratio, base):
    plan = plan_axis(base, 40, ratio)
    cell = np.floor((base + np.arange(40) + 0.5) * ratio + 1e-4).astype(int) - plan.low
    assert plan.is_coarser
    assert cell[0] == 0
    np.testing.assert_array_equal(plan.index, [np.flatnonzero(cell == k)[0] for k in range(cell[-1] + 1)])


@pytest.mark.parametrize("ratio", [1.0, 2.0, 3.3])
def test_finer_cells_take_the_voxel_that_holds_their_centre(ratio):
    plan = plan_axis(-3.0, 12, ratio)
    assert not plan.is_coarser
    centre = (plan.low + np.arange(len(plan.index)) + 0.5) / ratio + 3.0
    np.testing.assert_array_equal(plan.index, np.floor(centre + 1e-4).astype(int))
    assert plan.index.min() == 0
    assert plan.index.max() == 11


def test_the_largest_voxel_of_each_cell_is_taken():
    values = np.random.default_rng(0).integers(0, 100, (9, 7, 5)).astype(np.uint8)
    index = [0, 4, 6], [2, 2, 5], [0]
    plans = [AxisPlan(0, np.array(k), c) for k, c in zip(index, (True, False, True), strict=True)]
    found = take_largest(values, plans)
    runs = [slice(0, 4), slice(4, 6), slice(6, 9)]
    expected = [[[values[run, y].max()] for y in (2, 2, 5)] for run in runs]
    np.testing.assert_array_equal(found, expected)
