"""Search of all translations for given rotations, on the host or on an accelerator; the same scores."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..._runtime.threads import spread
from ..._types import Array
from ...maps.prepared import PreparedMap
from ...ops.evidence import correlate_host as host
from ...ops.evidence.correlate import coarse_spectra, correlation_peaks

CONFLICT_WEIGHT = 3.0
"""A coarse conflict is less certain than a fine one, which weighs 6."""

SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
"""Rungs of each axis of the block on an accelerator; multiples of 8 with factors 2 and 3 only."""

MAX_GROWTH = 1.8
"""A block may be so much larger than needed to share the compiled shape of another."""

Cells = tuple[int, int, int]
Peaks = tuple[np.ndarray, np.ndarray]


class Placement(NamedTuple):
    """Where both maps go in the coarse block for one rotation.

    Rotations that differ by quarter turns have one and the same block of b, reversed along some axes: its transform is
    computed once.

    Attributes:
        box_a: Cells that map a fills, from its low corner on.
        box_b: Those of map b.
        block_a: Rotation of map a into the block (3, 3).
        low_a: Low corner of a's box in the block's frame [m].
        upright_b: Rotation of map b into the block before any axis is reversed; the largest entry of each row is
            positive.
        upright_low_b: Low corner of b's box then [m].
        is_reversed: Whether each axis of b's box is reversed.
        cell: Width of a cell [m].
    """

    box_a: np.ndarray
    box_b: np.ndarray
    block_a: np.ndarray
    low_a: np.ndarray
    upright_b: np.ndarray
    upright_low_b: np.ndarray
    is_reversed: np.ndarray
    cell: float

    @property
    def block_b(self) -> np.ndarray:
        """Rotation of map b into the block."""
        return np.where(self.is_reversed[:, None], -self.upright_b, self.upright_b)

    @property
    def low_b(self) -> np.ndarray:
        """Low corner of b's box in the block's frame [m]."""
        return np.where(self.is_reversed, -(self.upright_low_b + self.box_b * self.cell), self.upright_low_b)


def search_on_host(
    a: PreparedMap, b: PreparedMap, factor: int, placements: Sequence[Placement], num_peaks: int
) -> list[Peaks]:
    """Scores and shifts [cell] of each placement, best first, rotations side by side on all cores.

    Args:
        a: First map.
        b: Second map.
        factor: Width of a cell [voxel].
        placements: One a rotation.
        num_peaks: Translations of each.
    """
    maps = a, b
    codes = [_coarse_block(m, factor) for m in maps]
    columns = [np.ascontiguousarray(np.asarray(m.points)[: m.num_points].T) for m in maps]
    weights = [np.asarray(m.weights, np.float64)[: m.num_points] for m in maps]

    def spectra(which: int, rotation: np.ndarray, low: np.ndarray, box: np.ndarray, cells: Cells) -> tuple:
        grid = maps[which].grid
        return host.coarse_spectra(
            codes[which], np.asarray(grid.origin, np.float64), grid.voxel_size, columns[which], weights[which],
            rotation, low,
            _triple(box), factor * grid.voxel_size, CONFLICT_WEIGHT, cells=cells,
        )  # fmt: skip

    needed = [_triple([host.block_size(int(n)) for n in p.box_a + p.box_b]) for p in placements]
    keys_a = [(0, cells, p.block_a.tobytes()) for cells, p in zip(needed, placements, strict=True)]
    keys_b = [(1, cells, p.upright_b.tobytes()) for cells, p in zip(needed, placements, strict=True)]
    first: dict[tuple, Placement] = {}
    for key_a, key_b, place in zip(keys_a, keys_b, placements, strict=True):
        first.setdefault(key_a, place)
        first.setdefault(key_b, place)

    def transform(key: tuple) -> tuple:
        place = first[key]
        if key[0] == 0:
            return spectra(0, place.block_a, place.low_a, place.box_a, key[1])
        return spectra(1, place.upright_b, place.upright_low_b, place.box_b, key[1])

    known = dict(zip(first, spread(transform, first), strict=True))

    def search(job: tuple[Placement, Cells, tuple, tuple]) -> Peaks:
        place, cells, key_a, key_b = job
        of_b = (host.reverse(field, place.is_reversed, cells=cells) for field in known[key_b])
        top, shift = host.correlation_peaks(*known[key_a], *of_b, cells=cells, num_peaks=num_peaks)
        # Reversing a box about its first cell brings its last cell there.
        shift = shift - np.where(place.is_reversed, place.box_b - 1, 0)
        return top, _unwrapped(shift, place.box_a, cells)

    return spread(search, zip(placements, needed, keys_a, keys_b, strict=True))


def search_on_device(
    a: PreparedMap, b: PreparedMap, factor: int, placements: Sequence[Placement], num_peaks: int
) -> list[Peaks]:
    """`search_on_host` on the default device: one rotation after the other, in blocks of few shapes."""
    cell = factor * a.grid.voxel_size
    codes_a, codes_b = a.coarse_codes(factor), b.coarse_codes(factor)
    needed = [_triple([_rung(int(n)) for n in p.box_a + p.box_b]) for p in placements]
    shared = _share_shapes(set(needed))
    spectra_a, found = {}, []
    for place, shape in zip(placements, needed, strict=True):
        cells = shared[shape]
        key = cells, place.block_a.tobytes()
        if key not in spectra_a:
            spectra_a[key] = _spectra(a, codes_a, place.block_a, place.low_a, cell, cells)
        of_b = _spectra(b, codes_b, place.block_b, place.low_b, cell, cells)
        top, shift = correlation_peaks(*spectra_a[key], *of_b, cells=cells, num_peaks=num_peaks)
        found.append((np.asarray(top), _unwrapped(np.asarray(shift, np.int64), place.box_a, cells)))
    return found


def _unwrapped(shift: np.ndarray, box_a: np.ndarray, cells: Cells) -> np.ndarray:
    """Shifts under which b meets a's box, from shifts modulo the block."""
    size = np.asarray(cells)
    shift = shift % size
    return np.where(shift >= box_a, shift - size, shift)


def _coarse_block(prepared: PreparedMap, factor: int) -> np.ndarray:
    """Coarse evidence codes as a block (x, y, z)."""
    shape = prepared.grid.states.shape
    return np.asarray(prepared.coarse_codes(factor))[: int(np.prod(shape))].reshape(shape)


def _triple(numbers: Sequence[int] | np.ndarray) -> Cells:
    x, y, z = (int(n) for n in numbers)
    return x, y, z


def _rung(cells: int) -> int:
    return next((size for size in SIZES if size >= cells), -(-cells // 64) * 64)


def _share_shapes(shapes: set[tuple[int, int, int]]) -> dict[tuple[int, int, int], tuple[int, int, int]]:
    """For each shape one that holds it and is not much larger; few different ones, because each is compiled."""
    shared: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    for shape in sorted(shapes, key=lambda n: (-np.prod(n), n)):
        fits = [
            other for other in set(shared.values())
            if all(m <= n for m, n in zip(shape, other, strict=True)) and np.prod(other) <= MAX_GROWTH * np.prod(shape)
        ]  # fmt: skip
        shared[shape] = min(fits, key=lambda n: (np.prod(n), n), default=shape)
    return shared


def _spectra(
    prepared: PreparedMap,
    codes: Array,
    rotation: np.ndarray,
    low: np.ndarray,
    cell: float,
    cells: tuple[int, int, int],
) -> tuple[Array, Array]:
    return coarse_spectra(
        codes, *prepared.block, prepared.points, prepared.weights,
        jnp.asarray(rotation, jnp.float32), jnp.asarray(low, jnp.float32), jnp.float32(cell),
        jnp.float32(CONFLICT_WEIGHT), cells=cells,
    )  # fmt: skip
