"""`correlate` on the host: blocks of any size without compilation, and rotations side by side on all cores.

On a CPU the transforms of SciPy are as fast as those of the compiler, and a block needs no rung of a ladder: exact
sizes save more than half of the work.
"""

from typing import cast

import numpy as np
from jaxtyping import Complex64, Float, Float32, UInt8
from scipy.fft import fft, irfftn, next_fast_len, rfft

from .lookup import Block, cells_on_host, turned_on_host
from .scoring import CONFLICT, HIT

PEAK_BLOCK = 4
"""At most one peak in each block of so many cells an axis."""


def block_size(cells: int) -> int:
    """Smallest quick length of a transform, a multiple of `PEAK_BLOCK`, that holds `cells`."""
    return PEAK_BLOCK * cast(int, next_fast_len(-(-cells // PEAK_BLOCK), real=True))


def coarse_spectra_on_host(
    codes: UInt8[np.ndarray, "flat"],
    block: Block,
    columns: Float32[np.ndarray, "3 n"],
    weights: Float[np.ndarray, "n"],
    rotation: Float[np.ndarray, "3 3"],
    low: Float[np.ndarray, "3"],
    box: tuple[int, int, int],
    cell_size: float,
    conflict_weight: float,
    *,
    cells: tuple[int, int, int],
) -> tuple[Complex64[np.ndarray, "x y w"], Complex64[np.ndarray, "x y w"]]:
    """Fourier transforms of one rotated map on a coarse block: what it offers, and what it asks.

    Args:
        codes: Evidence codes (`evidence_codes`) at the coarse tolerance, flat over the map's block; they may be longer.
        block: Place and size of that block: NumPy arrays, the origin in float64.
        columns: Occupied voxel centres in the map's frame [m], as rows x, y and z.
        weights: Weight of each point.
        rotation: Maps the map's frame into the frame of the coarse block.
        low: Outer corner of the coarse block [m].
        box: Cells of the coarse block, from `low` on, that can hold anything of the map.
        cell_size: Edge of a coarse cell [m].
        conflict_weight: How many hits a conflict outweighs.
        cells: Size of the coarse block; at least the sum of both maps' boxes, or the correlation wraps.

    Returns:
        Both spectra, as `correlate.coarse_spectra` gives them.
    """
    shape, voxel_size = np.asarray(block.dims).tolist(), float(block.voxel_size)
    # Cell centres in voxels of the map: a sum of one vector an axis.
    step = rotation * (cell_size / voxel_size)
    # A row times the rotation is turned back, from the block into the map.
    start = ((low + 0.5 * cell_size) @ rotation - np.asarray(block.origin)) / voxel_size

    def place(axis: int) -> np.ndarray:
        x, y, z = ((np.arange(n) * step[i, axis]).astype(np.float32) for i, n in enumerate(box))
        return (x[:, None] + (y + np.float32(start[axis]))[None, :])[:, :, None] + z[None, None, :]

    # What the map offers: codes at the centres of cells, as values.
    table = None if block.table is None else np.asarray(block.table)
    flat, is_inside = cells_on_host(map(place, range(3)), shape, table)
    # Code 0 says that nothing is known, and a product with False gives it to what lies outside.
    code = np.take(codes, flat) * is_inside
    values = np.zeros(4, np.float32)
    values[HIT], values[CONFLICT] = 1.0, -conflict_weight
    offer = np.take(values, code)

    # What the map asks: the weights of its voxels by cell. Rounding may put a voxel a hair outside of its box,
    # hence the clip.
    turn, shift = (rotation / cell_size).astype(np.float32), (low / cell_size).astype(np.float32)
    flat = np.zeros(1, np.int32)
    for axis, places in enumerate(turned_on_host(turn, columns)):
        places -= shift[axis]
        flat = flat * np.int32(box[axis]) + np.clip(places, 0, box[axis] - 1, out=places).astype(np.int32)
    ask = np.bincount(flat, weights, minlength=int(np.prod(box))).astype(np.float32).reshape(box)
    return filled_spectrum(offer, cells=cells), filled_spectrum(ask, cells=cells)


def filled_spectrum(
    field: Float32[np.ndarray, "_ _ _"], *, cells: tuple[int, int, int]
) -> Complex64[np.ndarray, "x y w"]:
    """`rfftn` of a field that is filled up with zeros, so that what is shifted past the map meets nothing.

    Args:
        field: Values in the low corner of the block.
        cells: Size of the block.
    """
    # Rows of zeros alone are not transformed: an axis is filled up when its turn comes. The order of the axes is that
    # of `rfftn`, and so are the bits.
    spectrum = rfft(field, n=cells[2], axis=2)
    for axis in range(2):
        spectrum = fft(spectrum, n=cells[axis], axis=axis, overwrite_x=True)
    return np.asarray(spectrum)


def reversed_spectrum(
    spectrum: Complex64[np.ndarray, "x y w"], is_reversed: np.ndarray, rows: slice = slice(None)
) -> Complex64[np.ndarray, "_ y w"]:
    """Transform of a real block reversed along some axes, about its first cell: `f(-x)` instead of `f(x)`.

    Args:
        spectrum: Half spectrum that `rfftn` gives.
        is_reversed: For each axis, whether to reverse it.
        rows: Which part along x to give.
    """
    # The half that is stored knows the last axis forward only: a real block's other half is the conjugate at -k.
    # The conjugate reverses all three axes, so the axes that shall differ from the last one are reversed here.
    backward = [-np.arange(size) % size for size in spectrum.shape[:2]]
    part = spectrum[backward[0][rows]] if is_reversed[0] != is_reversed[2] else spectrum[rows]
    if is_reversed[1] != is_reversed[2]:
        part = np.take(part, backward[1], axis=1)
    return np.conj(part) if is_reversed[2] else part


def matched_spectra(
    offer_a: Complex64[np.ndarray, "x y w"],
    ask_a: Complex64[np.ndarray, "x y w"],
    offer_b: Complex64[np.ndarray, "x y w"],
    ask_b: Complex64[np.ndarray, "x y w"],
    is_reversed: np.ndarray,
) -> Complex64[np.ndarray, "x y w"]:
    """Transform of the scores of all translations, `offer_a conj(ask_b) + ask_a conj(offer_b)`.

    Args:
        offer_a: What map a offers, from `coarse_spectra_on_host`.
        ask_a: What map a asks.
        offer_b: What map b offers.
        ask_b: What map b asks.
        is_reversed: For each axis, whether the block of b is reversed along it, about its first cell.
    """
    # Parts of so many entries stay in a core's cache through all the steps.
    most = 1 << 15
    total = np.empty_like(offer_a)
    step = max(most // max(offer_a[0].size, 1), 1)
    for start in range(0, len(total), step):
        rows = slice(start, start + step)
        # The conjugate turns convolution into correlation.
        asked, offered = (np.conj(reversed_spectrum(field, is_reversed, rows)) for field in (ask_b, offer_b))
        part = np.multiply(asked, offer_a[rows], out=total[rows])
        part += np.multiply(offered, ask_a[rows], out=offered)
    return total


def correlation_peaks_on_host(
    offer_a: Complex64[np.ndarray, "x y w"],
    ask_a: Complex64[np.ndarray, "x y w"],
    offer_b: Complex64[np.ndarray, "x y w"],
    ask_b: Complex64[np.ndarray, "x y w"],
    is_reversed: np.ndarray,
    *,
    cells: tuple[int, int, int],
    num_peaks: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Best translations of b against a, at most one in each block of cells; as `correlate.correlation_peaks`.

    Args:
        offer_a: What map a offers, from `coarse_spectra_on_host`.
        ask_a: What map a asks.
        offer_b: What map b offers.
        ask_b: What map b asks.
        is_reversed: For each axis, whether the block of b is reversed along it, about its first cell.
        cells: Size of the block; multiples of `PEAK_BLOCK`.
        num_peaks: At most so many.

    Returns:
        Scores float32 (k,), best first, and translations int64 (k, 3) [cell], modulo the block, in [0, cells).
    """
    # Both directions are summed before the one transform back.
    spectrum = matched_spectra(offer_a, ask_a, offer_b, ask_b, is_reversed)
    score = np.asarray(irfftn(spectrum, s=cells, overwrite_x=True))
    best = score
    # The largest of each block, one axis after the other; where it lies is only looked for in the blocks that are kept.
    for axis in range(3):
        parts = [best[(slice(None),) * axis + (slice(i, None, PEAK_BLOCK),)] for i in range(PEAK_BLOCK)]
        best = np.maximum(np.maximum(parts[0], parts[1]), np.maximum(parts[2], parts[3]))
    count = min(num_peaks, best.size)
    # The sort is stable: of equal scores the first block in C order comes first, on every machine.
    order = np.argsort(-best, axis=None, kind="stable")[:count]
    peaks = []
    for block in np.stack(np.unravel_index(order, best.shape), axis=-1) * PEAK_BLOCK:
        part = score[tuple(slice(i, i + PEAK_BLOCK) for i in block)]
        peaks.append(block + np.unravel_index(np.argmax(part), part.shape))
    return best.reshape(-1)[order], np.asarray(peaks, np.int64).reshape(-1, 3)
