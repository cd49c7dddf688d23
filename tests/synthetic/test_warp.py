"""Bending of worlds."""

import numpy as np

from voxjax.synthetic.warp import draw_warp


def test_a_warp_moves_points_by_as_much_as_is_asked_for_along_each_axis():
    warp = draw_warp(np.random.default_rng(0), (0.1, 0.2, 0.4), (1.0, 9.0))
    moved = warp(np.random.default_rng(1).uniform(-200.0, 200.0, (20_000, 3)))
    np.testing.assert_allclose(moved.std(axis=0), (0.1, 0.2, 0.4), rtol=0.1)


def test_neighbours_are_moved_alike():
    warp = draw_warp(np.random.default_rng(2), 0.1, (1.0, 9.0))
    points = np.random.default_rng(3).uniform(-20.0, 20.0, (1000, 3))
    assert np.abs(warp(points + 0.05) - warp(points)).max() < 0.05
    assert np.abs(warp(points + 5.0) - warp(points)).max() > 0.1
