"""How enclosed a voxel is: in how many of the 26 directions of the lattice something occupied lies within reach.

On the host, for grids have ever new shapes. Bits of a word are 64 voxels above each other, and so are the digits of
their counts. The grid is worked on in tiles of columns, side by side on all cores; tiles in which too few directions
lead to anything are left out.
"""

from collections import Counter
from itertools import product

import numpy as np
from jaxtyping import Bool, UInt64

from ..._runtime.threads import spread

DIRECTIONS = tuple(d for d in product((-1, 0, 1), repeat=3) if d != (0, 0, 0))
"""The 26 directions along x, y, z."""

_WORD = 64
"""Voxels above each other in a word."""

_Step = tuple[int, int, int]
_Window = tuple[slice, slice]
# Words of columns, or one truth value for each: those above each other, and the columns along x and y.
_Words = UInt64[np.ndarray, "w _ _"] | Bool[np.ndarray, "w _ _"]


def is_enclosed(
    occupied: Bool[np.ndarray, "x y z"],
    *,
    reach: float,
    min_directions: int,
    columns: _Window | None = None,
) -> Bool[np.ndarray, "x y z"]:
    """Whether a voxel meets something occupied along at least so many of the 26 directions.

    Beside the result, a bit a voxel is kept, and a tile for each core.

    Args:
        occupied: Voxels that stop a ray.
        reach: Length of the rays, from the voxel's centre [voxel]; the voxel itself does not count.
        min_directions: In how many directions something must be met, 1 to 26.
        columns: Columns along x and y that are asked about, the others being False; None for all of them.
    """
    enclosed = np.zeros(occupied.shape, bool)
    steps = _steps(occupied.shape, reach)
    if len(steps) < min_directions:
        return enclosed
    words = _pack(occupied)

    def fill(window: _Window) -> None:
        enclosed[window] = _unpack(_enclosed_tile(words, window, steps, min_directions), occupied.shape[2])

    # With halos no wider than tiles, the work on them stays below that on the tiles.
    edge = max(128, int(reach))
    wanted = _may_be_enclosed(words, steps, min_directions)
    if columns is not None:
        asked = np.zeros_like(wanted)
        asked[columns] = wanted[columns]
        wanted = asked
    spread(fill, _tiles(wanted, edge))
    return enclosed


def _steps(shape: tuple[int, ...], reach: float) -> dict[_Step, int]:
    """Number of steps along each direction that has any."""
    steps = {}
    for direction in DIRECTIONS:
        # More steps than this lead out of the grid from everywhere.
        inside = min(n - 1 for n, move in zip(shape, direction, strict=True) if move)
        # Rays have one length in all directions, so that diagonal ones have fewer steps.
        steps[direction] = min(int(reach / np.linalg.norm(direction)), inside)
    return {direction: count for direction, count in steps.items() if count > 0}


def _pack(occupied: Bool[np.ndarray, "x y z"]) -> UInt64[np.ndarray, "w x y"]:
    """Columns as words, the lowest voxel in the lowest bit of the first word."""
    width, height, depth = occupied.shape
    size = _WORD // 8
    packed = np.zeros((width, height, -(-depth // _WORD) * size), np.uint8)
    packed[..., : -(-depth // 8)] = np.packbits(occupied, axis=2, bitorder="little")
    return np.ascontiguousarray(np.moveaxis(packed.view("<u8"), 2, 0), np.uint64)


def _unpack(words: UInt64[np.ndarray, "w x y"], depth: int) -> Bool[np.ndarray, "x y z"]:
    """Columns of voxels from words."""
    packed = np.ascontiguousarray(np.moveaxis(words, 0, 2), "<u8").view(np.uint8)
    return np.unpackbits(packed, axis=2, count=depth, bitorder="little").view(bool)


def _may_be_enclosed(
    words: UInt64[np.ndarray, "w x y"], steps: dict[_Step, int], min_directions: int
) -> Bool[np.ndarray, "x y"]:
    """Columns from which enough directions lead to columns that hold anything."""
    _, width, height = words.shape
    filled = np.asarray(words.any(axis=0, keepdims=True))
    everywhere = slice(0, width), slice(0, height)
    count = np.zeros((width, height), np.uint8)
    # Directions of one course over the columns may have one number of steps, and lead to the same ones then.
    courses = Counter((x, y, number) for (x, y, _), number in steps.items())
    for (x, y, number), times in courses.items():
        met = filled
        # Straight up and down lead to the column itself.
        if (x, y) != (0, 0):
            met = _met(_with_halo(filled, everywhere, number), (x, y, 0), number, number)
        count += np.uint8(times) * met[0]
    return count >= min_directions


def _tiles(wanted: Bool[np.ndarray, "x y"], edge: int) -> list[_Window]:
    """Windows of at most `edge` columns a side, cut to the wanted columns in them; together they hold all of those."""
    windows = []
    for x, y in product(*(range(0, n, edge) for n in wanted.shape)):
        part = wanted[x : x + edge, y : y + edge]
        spans = [np.flatnonzero(part.any(axis=axis)) for axis in (1, 0)]
        if spans[0].size:
            low, high = [int(s[0]) for s in spans], [int(s[-1]) + 1 for s in spans]
            windows.append((slice(x + low[0], x + high[0]), slice(y + low[1], y + high[1])))
    return windows


def _with_halo(words: _Words, window: _Window, halo: int) -> _Words:
    """The columns of a window and so many on each side of it, empty outside the grid."""
    sizes = [part.stop - part.start + 2 * halo for part in window]
    around = np.zeros((len(words), *sizes), words.dtype)
    there, here = [], []
    for part, n in zip(window, words.shape[1:], strict=True):
        low, high = max(part.start - halo, 0), min(part.stop + halo, n)
        there.append(slice(low, high))
        here.append(slice(low - part.start + halo, high - part.start + halo))
    around[:, *here] = words[:, *there]
    return around


def _enclosed_tile(
    words: UInt64[np.ndarray, "w x y"], window: _Window, steps: dict[_Step, int], min_directions: int
) -> UInt64[np.ndarray, "w x2 y2"]:
    """Enclosed voxels of the columns of a window; bits above the grid mean nothing."""
    halo = max((number for (x, y, _), number in steps.items() if x or y), default=0)
    around = _with_halo(words, window, halo)
    # Numbers in digits: a list holds what counts 1, the next what counts 2, and so on.
    digits: list[list[np.ndarray]] = [[] for _ in range(len(DIRECTIONS).bit_length() + 1)]
    for direction, number in steps.items():
        _count(digits, _met(around, direction, number, halo))
    return _at_least(digits, min_directions)


def _met(around: _Words, direction: _Step, number: int, halo: int) -> _Words:
    """Whether something lies within so many steps along a direction, for the columns that a halo surrounds.

    Ranges double: what is met within 2 k steps is met within k steps here or k steps farther on.
    """
    *flat, up = direction
    # Columns that the last of the steps begins at; those that no later step looks at are left behind on the way.
    first = []
    for move, n in zip(flat, around.shape[1:], strict=True):
        ahead = (number - 1) * move
        first.append(slice(halo + move + min(ahead, 0), n - halo + move + max(ahead, 0)))
    met = _lowered(around[:, *first], up)
    covered = 1
    while covered < number:
        more = min(covered, number - covered)
        near, far = [slice(None)], [slice(None)]
        for move, n in zip(flat, met.shape[1:], strict=True):
            near.append(slice(max(-move, 0) * more, n - max(move, 0) * more))
            far.append(slice(max(move, 0) * more, n - max(-move, 0) * more))
        met = met[tuple(near)] | _lowered(met[tuple(far)], up * more)
        covered += more
    return met


def _lowered(words: _Words, count: int) -> _Words:
    """Columns moved down by so many voxels, or up where the number is negative; what comes in at the ends is empty."""
    if count == 0:
        return words
    whole, bits = divmod(abs(count), _WORD)
    moved = np.zeros_like(words)
    # Words are in the order in which voxels come into them, so that up is down but for the bits in a word.
    source, target = (words, moved) if count > 0 else (words[::-1], moved[::-1])
    along, against = (np.right_shift, np.left_shift) if count > 0 else (np.left_shift, np.right_shift)
    rest = max(len(words) - whole, 0)
    along(source[len(words) - rest :], np.uint64(bits), out=target[:rest])
    # A shift by all bits of a word has no meaning.
    if bits and rest > 1:
        target[: rest - 1] |= against(source[whole + 1 :], np.uint64(_WORD - bits))
    return moved


def _count(digits: list[list[np.ndarray]], bits: np.ndarray, place: int = 0) -> None:
    """Add words whose bits count `2**place` each; three words of one place become one of it and one of the next."""
    digits[place].append(bits)
    if len(digits[place]) == 3:
        a, b, c = digits[place]
        either = a ^ b
        digits[place] = [either ^ c]
        _count(digits, (a & b) | (either & c), place + 1)


def _at_least(digits: list[list[np.ndarray]], least: int) -> np.ndarray:
    """Where the numbers are at least `least`."""
    reached = np.uint64(2**_WORD - 1)
    for place, found in enumerate(digits):
        if len(found) == 2:
            a, b = found
            found[:] = [a ^ b]
            _count(digits, a & b, place + 1)
        digit = found[0] if found else np.uint64(0)
        # What higher digits leave undecided is as the lower ones say.
        reached = digit & reached if least >> place & 1 else digit | reached
    return np.asarray(reached)
