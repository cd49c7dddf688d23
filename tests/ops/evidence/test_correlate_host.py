# pyright: reportCallIssue=false
"""Spectra and peaks on the host against the definition."""

import itertools

import numpy as np
import pytest
from scipy.fft import rfftn

from oracles.evidence import shifted_score
from voxjax.ops.evidence import correlate_host as host

CELLS = (16, 24, 20)


def test_peaks_are_the_largest_two_way_scores():
    rng = np.random.default_rng(0)
    fields = rng.normal(size=(4, *CELLS)).astype(np.float32)
    spectra = [np.fft.rfftn(f).astype(np.complex64) for f in fields]
    forward = np.zeros(3, bool)
    top, shift = host.correlation_peaks_on_host(*spectra, forward, cells=CELLS, num_peaks=5)
    assert (np.diff(top) <= 0).all()
    for score, t in zip(top, shift, strict=True):
        assert abs(score - shifted_score(*fields, t)) < 1e-2
    best = max(shifted_score(*fields, t) for t in np.ndindex(*CELLS))
    assert abs(top[0] - best) < 1e-2
    assert (shift >= 0).all()
    assert (shift < np.asarray(CELLS)).all()


@pytest.mark.parametrize("needed", [1, 4, 17, 33, 101, 255])
def test_blocks_hold_what_is_needed_in_whole_peak_blocks(needed):
    size = host.block_size(needed)
    assert needed <= size <= max(1.35 * needed, needed + 4)
    assert size % host.PEAK_BLOCK == 0


@pytest.mark.parametrize("is_reversed", list(itertools.product([False, True], repeat=3)))
def test_a_reversed_block_has_the_reversed_transform(is_reversed):
    block = np.random.default_rng(2).normal(size=CELLS).astype(np.float32)
    axes = tuple(axis for axis in range(3) if is_reversed[axis])
    about_first = np.roll(np.flip(block, axes), 1, axes) if axes else block
    forward, expected = np.fft.rfftn(block), np.fft.rfftn(about_first)
    for rows in (slice(None), slice(3, 7), slice(12, 99)):
        spectrum = host.reversed_spectrum(forward, np.asarray(is_reversed), rows)
        np.testing.assert_allclose(spectrum, expected[rows], atol=1e-3)


@pytest.mark.parametrize("is_reversed", [(False, False, False), (True, False, False), (True, True, False)])
def test_spectra_are_matched_part_by_part(is_reversed):
    # Rows of these blocks are matched two at a time; of an odd number of them one is left over.
    cells = (7, 96, 240)
    rng = np.random.default_rng(3)
    spectra = [np.fft.rfftn(rng.normal(size=cells)).astype(np.complex64) for _ in range(4)]
    turned = [host.reversed_spectrum(field, np.asarray(is_reversed)) for field in spectra[2:]]
    expected = spectra[0] * np.conj(turned[1]) + spectra[1] * np.conj(turned[0])
    matched = host.matched_spectra(*spectra, np.asarray(is_reversed))
    np.testing.assert_allclose(matched, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).mean())


def test_a_block_filled_up_axis_by_axis_has_the_bits_of_one_transform():
    block = np.random.default_rng(4).normal(size=(9, 11, 6)).astype(np.float32)
    np.testing.assert_array_equal(host.filled_spectrum(block, cells=CELLS), rfftn(block, s=CELLS))
