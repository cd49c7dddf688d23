"""Colours: heights, maps, tints."""

import numpy as np

from voxjax.view.colors import MAP_COLORS, color_by_height, height_share, map_color, tint_by_height


def test_heights_give_different_colors_and_equal_heights_one():
    colors = color_by_height(np.linspace(0.0, 5.0, 50))
    assert len(np.unique(colors, axis=0)) > 30
    assert len(np.unique(color_by_height(np.full(5, 2.0)), axis=0)) == 1


def test_strays_do_not_eat_the_range_of_heights():
    heights = np.concatenate([np.linspace(0.0, 3.0, 1000), [500.0]])
    assert height_share(heights)[:1000].max() > 0.95
    assert len(height_share(np.zeros(0))) == 0


def test_more_maps_than_colors_begin_again():
    assert map_color(0) == map_color(len(MAP_COLORS)) != map_color(1)


def test_a_tint_is_full_high_up_and_paler_low_down():
    base = np.full((100, 3), (40, 90, 160), np.uint8)
    tinted = tint_by_height(base, np.linspace(0.0, 2.0, 100)).astype(int)
    np.testing.assert_array_equal(tinted[-1], base[-1])
    assert (np.diff(tinted, axis=0) <= 0).all()
    assert (tinted[0] > base[0]).all()
