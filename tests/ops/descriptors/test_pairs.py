"""Kernels on pairs of points in tiles, against loops of NumPy."""

import numpy as np
import pytest

from voxjax.ops.descriptors.pairs import FAR, bytes_of, closeness, count_bins, is_within, monomials


@pytest.fixture
def tiles():
    """Two tiles of 16 points and 128 others, some of which are no points, and their offsets (others, own, xyz)."""
    rng = np.random.default_rng(0)
    own, others = (
        rng.normal(size=(3, 2, 16)).astype(np.float32),
        rng.normal(size=(3, 2, 128)).astype(np.float32),
    )
    others[:, :, 100:] = FAR
    others[:, :, 3] = own[:, :, 5]
    return own, others, np.moveaxis(others[:, :, :, None] - own[:, :, None, :], 0, -1)


def test_pairs_within_a_distance_are_marked(tiles):
    own, others, offset = tiles
    expected = np.linalg.norm(offset.astype(np.float64), axis=-1) <= 1.5
    assert 0 < expected.sum() < expected.size
    np.testing.assert_array_equal(is_within(own, others, np.float32(1.5**2)), expected)


def test_monomials_are_those_of_the_offset_from_the_first_point(tiles):
    own, others, offset = tiles
    x, y, z = np.moveaxis(np.where(np.abs(offset[:, :, 0]) < 1e8, offset[:, :, 0], 0.0), -1, 0)
    one = np.ones_like(x)
    one[:, 100:] = 0.0
    expected = np.stack([one, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=2)
    np.testing.assert_allclose(monomials(own, others), expected, rtol=1e-5, atol=1e-6)


def test_closeness_falls_with_the_distance_and_has_bounds(tiles):
    own, others, offset = tiles
    length = np.linalg.norm(offset.astype(np.float64), axis=-1)
    near = np.where((length > 0) & (length <= 2.0), 0.3 / np.maximum(length, 0.15), 0.0)
    found = np.asarray(closeness(own, others, np.float32(4.0), np.float32(0.3)))
    np.testing.assert_allclose(found, near, rtol=1e-5)
    assert found.max() <= 2.0 + 1e-6
    np.testing.assert_array_equal(found[:, 3, 5], 0.0)


def test_bins_are_counted_and_words_are_cut_into_bytes():
    rng = np.random.default_rng(1)
    words = rng.integers(0, 2**32, (2, 128, 16), dtype=np.uint32)
    bins = bytes_of(words)
    for byte in range(4):
        np.testing.assert_array_equal(bins[:, :, byte::4], (words >> np.uint32(8 * byte)) & np.uint32(255))
    bins = rng.integers(0, 12, (2, 128, 64)).astype(np.uint8)
    counts = np.asarray(count_bins(bins, num_bins=11))
    np.testing.assert_array_equal(counts, (bins[:, :, None] == np.arange(11)[:, None]).sum(axis=1))
