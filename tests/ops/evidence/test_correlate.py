import numpy as np

from oracles.evidence import shifted_score
from voxjax.ops.evidence.correlate import coarse_spectra, correlation_peaks
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.nearest import nearest_field
from voxjax.ops.evidence.scoring import evidence_codes

CELLS = (16, 24, 16)


def spectrum(x):
    return np.fft.rfftn(x).astype(np.complex64)


def test_peaks_are_the_largest_two_way_scores():
    rng = np.random.default_rng(0)
    offer_a, ask_a, offer_b, ask_b = rng.normal(size=(4, *CELLS)).astype(np.float32)
    top, shift = correlation_peaks(
        spectrum(offer_a), spectrum(ask_a), spectrum(offer_b), spectrum(ask_b), cells=CELLS, num_peaks=5
    )
    top, shift = np.asarray(top), np.asarray(shift)
    assert (np.diff(top) <= 0).all()
    for score, t in zip(top, shift, strict=True):
        assert abs(score - shifted_score(offer_a, ask_a, offer_b, ask_b, t)) < 1e-2
    best = max(
        shifted_score(offer_a, ask_a, offer_b, ask_b, (x, y, z))
        for x in range(CELLS[0])
        for y in range(CELLS[1])
        for z in range(CELLS[2])
    )
    assert abs(top[0] - best) < 1e-2
    assert (shift >= 0).all()
    assert (shift < np.asarray(CELLS)).all()


def test_a_search_has_no_more_peaks_than_blocks():
    rng = np.random.default_rng(0)
    spectra = [spectrum(part) for part in rng.normal(size=(4, *CELLS)).astype(np.float32)]
    top, shift = correlation_peaks(*spectra, cells=CELLS, num_peaks=1000)
    assert len(top) == len(shift) == 4 * 6 * 4
    assert len(np.unique(np.asarray(shift) // 4, axis=0)) == len(shift)


def test_a_shifted_map_is_found_at_its_shift():
    rng = np.random.default_rng(1)
    states = np.ones((8, 9, 7), np.uint8)
    states[rng.random(states.shape) < 0.15] = 2
    index = np.argwhere(states == 2).astype(np.int32)
    dims = np.asarray(states.shape, np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=states.size, radius=3)
    codes = evidence_codes(states.reshape(-1), keys, 0, 1)
    weights = np.full(len(index), 1 / len(index), np.float32)

    def spectra(origin, low):
        points = (origin + (index + 0.5) * 0.5).astype(np.float32)
        return coarse_spectra(
            codes,
            Block(dims, origin, np.float32(0.5)),
            points,
            weights,
            np.eye(3, dtype=np.float32),
            low,
            np.float32(0.5),
            np.float32(3.0),
            cells=CELLS,
        )

    origin_a, origin_b = np.asarray([1, 2, 3], np.float32), np.asarray([-1.5, 4, 0.5], np.float32)
    low_a, low_b = origin_a - np.float32(0.5), origin_b - np.float32(1.0)
    top, shift = correlation_peaks(
        *spectra(origin_a, low_a), *spectra(origin_b, low_b), cells=CELLS, num_peaks=3
    )
    wrapped = np.asarray(shift)[0]
    shift = np.where(wrapped >= np.asarray(CELLS) // 2, wrapped - np.asarray(CELLS), wrapped)
    translation = low_a - low_b + shift * np.float32(0.5)
    np.testing.assert_allclose(translation, origin_a - origin_b, atol=1e-5)
    assert abs(float(top[0]) - 2.0) < 1e-4
