"""Search of all translations for given rotations: the two-way evidence of every shift, by Fourier transform.

`search_translations` chooses between transforms of exact sizes in NumPy and SciPy (`correlate_host`), rotations side by
side, and kernels of few shapes (`correlate`), one rotation after the other; the scores are the same but for rounding.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._runtime.placement import on_host, to_device
from ..._runtime.threads import spread
from ..._types import Array
from .correlate import coarse_spectra, correlation_peaks
from .correlate_host import block_size, coarse_spectra_on_host, correlation_peaks_on_host
from .lookup import Block

Cells = tuple[int, int, int]
Peaks = tuple[np.ndarray, np.ndarray]

BATCH_BYTES = 1 << 27
"""What is transformed for the placements that are searched together takes at most so much, on the host."""


class CoarseMap(NamedTuple):
    """What the search needs of a map.

    Attributes:
        codes: Evidence codes at the tolerance of a coarse cell, flat over the map's block; they may be longer.
        block: Place and size of that block, its origin in float64 on the host.
        points: Table of the occupied voxel centres (n, 3) [m].
        weights: Table of their weights (n,), 0 for padding.
        num_points: Rows of both tables that are not padding.
    """

    codes: Array
    block: Block
    points: Array
    weights: Array
    num_points: int


class Placement(NamedTuple):
    """Where both maps go in the coarse block for one rotation.

    Rotations that differ by quarter turns have one and the same block of b, reversed along some axes: its transform is
    computed once.

    Attributes:
        box_a: Cells that map a fills, from its low corner on.
        box_b: Cells that map b fills, from its low corner on.
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
        # Reversed, the high end of the box comes first, with its sign changed.
        return np.where(self.is_reversed, -(self.upright_low_b + self.box_b * self.cell), self.upright_low_b)


def search_translations(
    a: CoarseMap,
    b: CoarseMap,
    placements: Sequence[Placement],
    *,
    num_peaks: int,
    conflict_weight: float,
) -> list[Peaks]:
    """Best translations of map b for each of some rotations, at most one in each block of 4 x 4 x 4 cells.

    Args:
        a: First map.
        b: Second map.
        placements: One a rotation, all with cells of one width.
        num_peaks: Translations kept for each rotation.
        conflict_weight: How many hits a conflict outweighs.

    Returns:
        For each placement the scores float32 (k,), best first, and the shifts int64 (k, 3) [cell] of b's box in a's.
    """
    if not on_host(a.codes, b.codes):
        return _search_by_kernels(a, b, placements, num_peaks, conflict_weight)
    found: list[Peaks | None] = [None] * len(placements)
    for rows in _batches(placements):
        some = _search_on_host(a, b, [placements[row] for row in rows], num_peaks, conflict_weight)
        for row, peaks in zip(rows, some, strict=True):
            found[row] = peaks
    return [peaks for peaks in found if peaks is not None]


def _needed(place: Placement) -> Cells:
    """A block that holds both boxes end to end, so that no translation wraps round."""
    return _triple([block_size(int(n)) for n in place.box_a + place.box_b])


def _batches(placements: Sequence[Placement], most: int = BATCH_BYTES) -> list[list[int]]:
    """Rows of placements that are searched together: what is transformed for them takes at most so many bytes.

    Placements that share transforms follow each other. Those of buildings are one batch; batches of outdoor maps take
    the memory that those before have left, for fresh pages of half a gigabyte cost as much as the transforms.
    """
    names = [(_needed(place), place.upright_b.tobytes()) for place in placements]
    batches: list[list[int]] = []
    held, taken = set(), 0.0
    for row in sorted(range(len(placements)), key=names.__getitem__):
        # Two half spectra of complex64 take eight bytes a cell; a block of its own size has one of map a, too.
        new = {names[row], names[row][0]} - held
        size = 8.0 * math.prod(names[row][0]) * len(new)
        if not batches or taken + size > most:
            batches.append([])
            held, taken = set(), 0.0
        batches[-1].append(row)
        held |= {names[row], names[row][0]}
        taken += size
    return batches


def _search_on_host(
    a: CoarseMap, b: CoarseMap, placements: Sequence[Placement], num_peaks: int, conflict_weight: float
) -> list[Peaks]:
    """`search_translations` in NumPy: each rotated map is transformed once, rotations side by side on all cores."""
    maps = a, b
    codes = [np.asarray(m.codes) for m in maps]
    # Tables go on past what is in them, and what follows means nothing.
    columns = [np.ascontiguousarray(np.asarray(m.points)[: m.num_points].T) for m in maps]
    # `np.bincount` sums in float64, and would convert float32 weights anew for each rotation.
    weights = [np.asarray(m.weights, np.float64)[: m.num_points] for m in maps]

    def spectra(which: int, rotation: np.ndarray, low: np.ndarray, box: np.ndarray, cells: Cells) -> tuple:
        given = codes[which], maps[which].block, columns[which], weights[which]
        return coarse_spectra_on_host(
            *given, rotation, low, _triple(box), placements[0].cell, conflict_weight, cells=cells
        )

    # What is transformed is named by map, block and rotation; each name is worked on once, however many placements
    # share it.
    needed = [_needed(place) for place in placements]
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
        # Quarter turns of b differ from the transformed one by reversed axes alone.
        given = *known[key_a], *known[key_b], place.is_reversed
        top, shift = correlation_peaks_on_host(*given, cells=cells, num_peaks=num_peaks)
        # Reversing a box about its first cell brings its last cell there.
        shift = shift - np.where(place.is_reversed, place.box_b - 1, 0)
        return top, _unwrapped(shift, place.box_a, cells)

    return spread(search, zip(placements, needed, keys_a, keys_b, strict=True))


def _search_by_kernels(
    a: CoarseMap, b: CoarseMap, placements: Sequence[Placement], num_peaks: int, conflict_weight: float
) -> list[Peaks]:
    """`search_translations` on the default device: one rotation after the other, in blocks of few shapes."""

    def spectra(m: CoarseMap, rotation: np.ndarray, low: np.ndarray, cell: float, cells: Cells) -> tuple:
        origin, voxel_size = np.asarray(m.block.origin, np.float32), np.float32(m.block.voxel_size)
        block = m.block._replace(origin=origin, voxel_size=voxel_size)
        place = rotation.astype(np.float32), low.astype(np.float32), np.float32(cell)
        numbers = to_device((*place, np.float32(conflict_weight)))
        return coarse_spectra(m.codes, to_device(block), m.points, m.weights, *numbers, cells=cells)

    needed = [_triple([_rung(int(n)) for n in p.box_a + p.box_b]) for p in placements]
    shared = _share_shapes(set(needed))
    # Placements share a's spectra where they can; b's are made anew, which keeps device memory to one of them.
    spectra_a, found = {}, []
    for place, shape in zip(placements, needed, strict=True):
        cells = shared[shape]
        # An array cannot be a key, but its bytes can.
        key = cells, place.block_a.tobytes()
        if key not in spectra_a:
            spectra_a[key] = spectra(a, place.block_a, place.low_a, place.cell, cells)
        of_b = spectra(b, place.block_b, place.low_b, place.cell, cells)
        top, shift = correlation_peaks(*spectra_a[key], *of_b, cells=cells, num_peaks=num_peaks)
        found.append((np.asarray(top), _unwrapped(np.asarray(shift, np.int64), place.box_a, cells)))
    return found


def _unwrapped(shift: np.ndarray, box_a: np.ndarray, cells: Cells) -> np.ndarray:
    """Shifts under which b meets a's box, from shifts modulo the block."""
    # The low corner of b's box lies within a's, or below it: from the end of a's box on a shift has wrapped round.
    size = np.asarray(cells)
    shift = shift % size
    return np.where(shift >= box_a, shift - size, shift)


def _triple(numbers: Sequence[int] | np.ndarray) -> Cells:
    x, y, z = (int(n) for n in numbers)
    return x, y, z


def _rung(cells: int) -> int:
    """Length of an axis of a block that kernels transform: a multiple of 8 with factors 2 and 3 only."""
    sizes = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
    return next((size for size in sizes if size >= cells), -(-cells // 64) * 64)


def _share_shapes(shapes: set[Cells], *, max_growth: float = 1.8) -> dict[Cells, Cells]:
    """For each shape one that holds it and is at most `max_growth` times as large; few, because each is compiled."""
    shared: dict[Cells, Cells] = {}

    def holds(other: Cells, shape: Cells) -> bool:
        return all(m <= n for m, n in zip(shape, other, strict=True))

    # The largest first: those that follow may find one that holds them. The order is fixed, and so are the blocks.
    for shape in sorted(shapes, key=lambda n: (-np.prod(n), n)):
        most = max_growth * np.prod(shape)
        fits = [other for other in set(shared.values()) if holds(other, shape) and np.prod(other) <= most]
        shared[shape] = min(fits, key=lambda n: (np.prod(n), n), default=shape)
    return shared
