"""Panels of a sheet: titles, legends, and what is cut off."""

import numpy as np

from voxjax.view.panels import framed, legend, rows, stack, titled, trimmed

RED, GREEN = (200, 0, 0), (0, 150, 0)


def _blank(height, width):
    return np.full((height, width, 3), 255, np.uint8)


def test_only_rows_that_are_empty_in_all_images_are_cut_off():
    one, two = _blank(100, 8), _blank(100, 9)
    one[40:50, 3] = RED
    two[60:70, 3] = RED
    cut = trimmed([one, two], margin=5)
    np.testing.assert_array_equal(cut[0], one[35:75])
    np.testing.assert_array_equal(cut[1], two[35:75])


def test_images_that_show_nothing_stay_as_they_are():
    assert trimmed([_blank(7, 3)], margin=1)[0].shape == (7, 3, 3)


def test_a_margin_never_reaches_beyond_the_image():
    image = _blank(10, 4)
    image[[0, 9], 1] = RED
    np.testing.assert_array_equal(trimmed([image], margin=20)[0], image)


def test_a_legend_has_each_color_left_of_its_label():
    line = legend([("a", RED), ("b", GREEN)], 300)
    columns = [np.flatnonzero((line == color).all(axis=-1).any(axis=0)) for color in (RED, GREEN)]
    is_ink = np.flatnonzero((line == (40, 44, 52)).all(axis=-1).any(axis=0))
    assert columns[0].max() < is_ink.min() < columns[1].min() < is_ink.max()


def test_a_title_that_is_too_long_keeps_the_width():
    assert titled(_blank(20, 120), "a name that is far too long for its picture").shape[1] == 120


def test_panels_of_different_sizes_are_filled_up_with_background():
    red = np.full((4, 6, 3), RED, np.uint8)
    sheet = rows([red, _blank(9, 2), red], per_row=2)
    assert sheet.shape == (13, 8, 3)
    assert (sheet == RED).all(axis=-1).sum() == 48
    assert (sheet[4:9, :6] == 255).all()
    assert stack([red, _blank(1, 9)]).shape == (5, 9, 3)
    assert framed(red, margin=2).shape == (8, 10, 3)
