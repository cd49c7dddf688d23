from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compilations import assert_compiles_nothing
from oracles.descriptors import mutual_pairs
from voxjax.ops.descriptors import match as descriptor_match
from voxjax.ops.descriptors.match import mutual_nearest, mutual_nearest_kernel


def pairs(a, b, mask_a, mask_b, match=mutual_nearest):
    nearest, is_mutual, square = map(np.asarray, match(a, b, mask_a, mask_b))
    assert nearest.dtype == np.int32
    rows = np.flatnonzero(is_mutual)
    return [(int(i), int(nearest[i])) for i in rows], square[rows]


@pytest.mark.parametrize(
    "match", [mutual_nearest, partial(mutual_nearest_kernel, chunk=8), mutual_nearest_kernel]
)
@pytest.mark.parametrize(("n", "m"), [(40, 30), (7, 50), (65, 64), (1, 1)])
def test_pairs_are_each_others_nearest(n, m, match):
    rng = np.random.default_rng(n)
    a, b = (rng.random((k, 6)).astype(np.float32) for k in (n, m))
    mask_a, mask_b = np.arange(n) != 3, np.arange(m) != 5
    found, square = pairs(a, b, mask_a, mask_b, match)
    assert found == mutual_pairs(a.astype(float), b.astype(float), mask_a, mask_b)
    np.testing.assert_allclose(square, [((a[i] - b[j]) ** 2).sum() for i, j in found], atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_exchanging_the_sets_exchanges_the_pairs(seed):
    rng = np.random.default_rng(seed)
    a, b = (rng.random((k, 4)).astype(np.float32) for k in (20, 24))
    mask_a, mask_b = rng.random(20) < 0.8, rng.random(24) < 0.8
    forth, _ = pairs(a, b, mask_a, mask_b)
    back, _ = pairs(b, a, mask_b, mask_a)
    assert forth == sorted((i, j) for j, i in back)


def test_blocks_give_the_pairs_of_the_kernel(monkeypatch):
    rng = np.random.default_rng(1)
    a, b = (rng.random((k, 5)).astype(np.float32) for k in (101, 77))
    mask_a, mask_b = rng.random(101) < 0.8, rng.random(77) < 0.8
    expected = pairs(a, b, mask_a, mask_b, mutual_nearest_kernel)
    for rows, columns in ((512, 512), (16, 8), (7, 77), (101, 3)):
        monkeypatch.setattr(descriptor_match, "_ROWS", rows)
        monkeypatch.setattr(descriptor_match, "_COLUMNS", columns)
        found, square = pairs(a, b, mask_a, mask_b)
        assert found == expected[0]
        np.testing.assert_allclose(square, expected[1], atol=1e-5)


def test_other_numbers_of_rows_compile_nothing():
    def match(n):
        a = np.random.default_rng(n).random((n, 33)).astype(np.float32)
        assert len(pairs(a, a, np.ones(n, bool), np.ones(n, bool))[0]) == n

    match(5)
    with assert_compiles_nothing(descriptor_match._squares):
        match(700)
        match(1201)


@pytest.mark.parametrize("match", [mutual_nearest, mutual_nearest_kernel])
def test_empty_sets_match_nothing(match):
    a, none = np.ones((3, 4), np.float32), np.zeros((0, 4), np.float32)
    assert pairs(none, a, np.zeros(0, bool), np.ones(3, bool), match)[0] == []
    if match is mutual_nearest:
        assert pairs(a, none, np.ones(3, bool), np.zeros(0, bool), match)[0] == []


def test_equal_sets_match_themselves():
    a = np.random.default_rng(0).random((30, 5)).astype(np.float32)
    found, square = pairs(a, a, np.ones(30, bool), np.ones(30, bool))
    assert found == [(i, i) for i in range(30)]
    assert square.min() >= 0.0
    np.testing.assert_allclose(square, 0.0, atol=1e-5)


def test_nothing_matches_what_takes_no_part():
    a = np.zeros((4, 3), np.float32)
    assert pairs(a, a, np.ones(4, bool), np.zeros(4, bool))[0] == []
    assert pairs(a, a, np.zeros(4, bool), np.ones(4, bool))[0] == []


def test_ties_go_to_the_lower_row():
    a = np.zeros((3, 2), np.float32)
    assert pairs(a, a, np.ones(3, bool), np.ones(3, bool))[0] == [(0, 0)]
