import numpy as np
import pytest

from voxjax.matching.cells import Cells, average_by_cell, toward_surroundings


def points_in(size, *, count=400, seed=0):
    return np.random.default_rng(seed).uniform(0.0, size, (count, 3))


# Counted where there are few cells for so many points, sorted where there are many.
@pytest.mark.parametrize("size", [(6.0, 4.0, 3.0), (900.0, 40.0, 30.0)])
def test_cells_are_those_that_hold_a_point_in_c_order(size):
    points = points_in(size)
    cells = Cells.of(points, 1.0)
    places = np.floor(points).astype(int)
    places -= places.min(axis=0)
    expected, number, count = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    np.testing.assert_array_equal(cells.index, expected)
    np.testing.assert_array_equal(cells.number, number.reshape(-1))
    np.testing.assert_array_equal(cells.count, count)
    np.testing.assert_array_equal(cells.shape, places.max(axis=0) + 1)
    cell, means = average_by_cell(points, 1.0)
    np.testing.assert_array_equal(cell, cells.number)
    np.testing.assert_allclose(means[3], points[cell == 3].mean(axis=0))


def test_the_surroundings_are_the_cells_around():
    points = points_in((9.0, 7.0, 5.0))
    cell = np.floor(points) - np.floor(points).min(axis=0)
    near = (np.abs(cell[:, None] - cell[None]) <= 2).all(axis=2)
    expected = np.stack([points[row].mean(axis=0) for row in near]) - points
    np.testing.assert_allclose(toward_surroundings(points, 1.0), expected, atol=1e-12)


def test_surroundings_are_the_same_in_tiles_but_for_rounding():
    points = points_in((300.0, 130.0, 20.0), count=4000)
    whole, tiled = (toward_surroundings(points, 1.0, most=most) for most in (1 << 22, 1 << 16))
    np.testing.assert_allclose(tiled, whole, atol=1e-9)
    assert np.abs(whole).max() > 1.0


def test_no_points_have_no_cells():
    cell, means = average_by_cell(np.zeros((0, 3)), 1.0)
    assert cell.shape == (0,)
    assert means.shape == (0, 3)
    assert toward_surroundings(np.zeros((0, 3)), 1.0).shape == (0, 3)
