# pyright: reportCallIssue=false
"""Spectra and peaks on the host against the definition."""

import itertools

import numpy as np
import pytest

from oracles.evidence import shifted_score
from voxjax.ops.evidence import correlate_host as host

CELLS = (16, 24, 20)


def test_peaks_are_the_largest_two_way_scores():
    rng = np.random.default_rng(0)
    fields = rng.normal(size=(4, *CELLS)).astype(np.float32)
    spectra = [np.fft.rfftn(f).astype(np.complex64) for f in fields]
    top, shift = host.correlation_peaks_on_host(*spectra, cells=CELLS, num_peaks=5)
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
    spectrum = host.reversed_spectrum(np.fft.rfftn(block), np.asarray(is_reversed), cells=CELLS)
    np.testing.assert_allclose(spectrum, np.fft.rfftn(about_first), atol=1e-3)
