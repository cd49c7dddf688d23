"""Candidate associations: all of them, those of one kind, and what is refused."""

import itertools

import numpy as np
import pytest

from voxjax import InputError
from voxjax.features.types import KIND_UNKNOWN
from voxjax.matching.associations import all_associations, check_associations, same_kind


def test_all_rows_that_count_are_paired_in_lexicographic_order():
    mask_a, mask_b = np.asarray([True, False, True]), np.asarray([False, True, True, False])
    assert all_associations(mask_a, mask_b).tolist() == [list(p) for p in itertools.product((0, 2), (1, 2))]


def test_unknown_kinds_match_all_and_known_ones_their_own():
    kinds_a, kinds_b = np.array([0, 1, KIND_UNKNOWN], np.uint8), np.array([1, 0], np.uint8)
    every = all_associations(np.ones(3, bool), np.ones(2, bool))
    assert same_kind(every, kinds_a, kinds_b).tolist() == [[0, 1], [1, 0], [2, 0], [2, 1]]


@pytest.mark.parametrize("wrong", [[[0, 2]], [[2, 0]], [[-1, 0]]])
def test_associations_of_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="associations"):
        check_associations(np.asarray(wrong), 2, 2)
