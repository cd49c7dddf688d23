"""The pixel alphabet: letters can be told apart and stay inside the picture."""

import itertools

import numpy as np

from voxjax.view.font import text_mask, write_text

_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.,:-+%/()_=<>|#'*"


def test_no_two_letters_look_the_same():
    for first, second in itertools.combinations(_LETTERS, 2):
        assert not np.array_equal(text_mask(first), text_mask(second)), (first, second)


def test_lower_case_is_drawn_as_upper_case_and_unknown_letters_as_question_marks():
    np.testing.assert_array_equal(text_mask("map é"), text_mask("MAP ?"))


def test_text_that_does_not_fit_is_cut_off():
    image = np.full((10, 20, 3), 255, np.uint8)
    write_text(image, "A LONG LINE", left=8, top=2, color=(0, 0, 0))
    assert (image[:2] == 255).all()
    assert (image[2:, 8:] == 0).any()
