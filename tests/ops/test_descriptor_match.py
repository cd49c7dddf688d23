import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.descriptors import mutual_pairs
from voxjax.ops.descriptor_match import mutual_nearest


def pairs(a, b, mask_a, mask_b, **options):
    nearest, is_mutual, square = map(np.asarray, mutual_nearest(a, b, mask_a, mask_b, **options))
    rows = np.flatnonzero(is_mutual)
    return [(int(i), int(nearest[i])) for i in rows], square[rows]


@pytest.mark.parametrize(("n", "m", "chunk"), [(40, 30, 8), (7, 50, 64), (65, 64, 64), (1, 1, 64)])
def test_pairs_are_each_others_nearest(n, m, chunk):
    rng = np.random.default_rng(n)
    a, b = (rng.random((k, 6)).astype(np.float32) for k in (n, m))
    mask_a, mask_b = np.arange(n) != 3, np.arange(m) != 5
    found, square = pairs(a, b, mask_a, mask_b, chunk=chunk)
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
