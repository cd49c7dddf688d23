"""The field of nearest voxels and its evidence codes on the host: slabs that stay in the cache of a core, side by side.

Nothing is compiled for a block of another size. Columns along z that no voxel is near are left out of all passes, for
in maps of the outdoors those are most.
"""

import numpy as np
from jaxtyping import Bool, Int32, UInt8, UInt32

from ..._checks import InputError
from ..._runtime.tables import reserve
from ..._runtime.threads import spread
from ..._types import FREE
from .nearest import INDEX_BITS, NOTHING_NEAR
from .scoring import CONFLICT, HIT, NEUTRAL

SLAB = 1 << 16
"""Cells that are worked on at once: with as many of what is added to them they fill a quarter of a MiB each."""


def nearest_field_on_host(
    index: Int32[np.ndarray, "n 3"], shape: tuple[int, int, int], *, length: int, radius: int
) -> UInt32[np.ndarray, "length"]:
    """The cells of the block in `nearest.nearest_field`, bit for bit.

    Args:
        index: Different voxels inside the block, in C order.
        shape: Size of the block [voxel].
        length: Length of the result, at least `prod(shape)`; what follows the block is 0 and takes no memory.
        radius: Reach [voxel], 1 to 5.

    Raises:
        InputError: If the radius or the number of rows does not fit the key.
    """
    # Sums of two squared distances must fit the six bits of a key.
    max_radius = 5
    if not 1 <= radius <= max_radius:
        raise InputError(f"radius must be 1 to {max_radius} voxels, got {radius}.")
    if len(index) >= 1 << INDEX_BITS:
        raise InputError(f"index must list fewer than {1 << INDEX_BITS} voxels, got {len(index)}.")
    width, height, depth = shape
    field = reserve(length, dtype=np.uint32)
    block = field[: width * height * depth].reshape(shape)
    columns = block.reshape(-1, depth)
    filled = np.zeros((width, height), bool)
    filled[index[:, 0], index[:, 1]] = True
    # The list is in C order: the voxels of a plane are a slice of it, so slabs need no search.
    first = np.searchsorted(index[:, 0], np.arange(width + 1)).tolist()

    def spread_in_planes(planes: slice) -> None:
        places = np.flatnonzero(_near(filled[planes], radius))
        # A gap after each column, so that steps along it never leave it.
        keys = np.full((len(places), depth + radius), NOTHING_NEAR)
        rows = slice(first[planes.start], first[planes.stop])
        x, y, z = index[rows].T
        slots = np.searchsorted(places, (x - planes.start).astype(np.int64) * (height + radius) + y)
        keys[slots, z] = np.arange(rows.start, rows.stop, dtype=np.uint32)
        flat = keys.reshape(-1)
        # The order of axes does not matter; z and y come first, because their neighbours are in the slab.
        _spread_along(flat, 1, radius)
        _spread_along(flat, depth + radius, radius)
        block[planes] = NOTHING_NEAR
        x, y = np.divmod(places, height + radius)
        is_inside = y < height
        columns[((x + planes.start) * height + y)[is_inside]] = keys[is_inside, :depth]

    # Along x all planes are needed, so this pass cuts the block the other way, and begins when the first one has ended.
    reached = _near(filled, radius)[:, :height]
    across = np.ascontiguousarray(reached.T)

    def spread_across_planes(lines: slice) -> None:
        places = np.flatnonzero(_near(across[lines], radius))
        y, x = np.divmod(places, width + radius)
        is_inside = x < width
        source = (x * height + y + lines.start)[is_inside]
        keys = np.full((len(places), depth), NOTHING_NEAR)
        keys[is_inside] = columns[source]
        _spread_along(keys.reshape(-1), depth, radius)
        columns[source] = keys[is_inside]

    spread(spread_in_planes, _slabs(reached, depth))
    spread(spread_across_planes, _slabs(_near(across, radius), depth))
    return field


def _near(filled: Bool[np.ndarray, "lines n"], radius: int) -> Bool[np.ndarray, "lines gapped"]:
    """Columns of lines that are near a filled one in their line, and in a gap of `radius` columns after each line.

    In a list of these alone, whatever is up to `radius` columns from a filled one is as far from it as in the line, so
    that steps along lines may leave out all others.
    """
    gapped = np.pad(filled, ((0, 0), (0, radius)))
    flat = gapped.reshape(-1)
    near = flat.copy()
    for step in range(1, min(radius, len(flat)) + 1):
        near[step:] |= flat[:-step]
        near[:-step] |= flat[step:]
    return near.reshape(gapped.shape)


def _slabs(near: Bool[np.ndarray, "lines n"], depth: int) -> list[slice]:
    """All lines, in slices whose near columns have about as many cells as a slab."""
    cells = np.cumsum(near.sum(axis=1)) * depth
    # A line belongs to the slab that the cells before its end have filled so far.
    ends = np.flatnonzero(np.diff(cells // SLAB, append=-1)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *ends[:-1]], ends, strict=True)]


def _spread_along(keys: np.ndarray, stride: int, radius: int) -> None:
    """Least key along one axis in place, the squared step added; keys farther than the radius are dropped."""
    # What is farther than the radius counts as one more than its square: a squared step added to it fits 32 bits still,
    # where one added to the mark of nothing would wrap round.
    beyond = np.uint32((radius * radius + 1) << INDEX_BITS)
    source = np.minimum(keys, beyond)
    # All steps read what the pass began with, so the least keys are gathered in another array.
    best, other = source.copy(), np.empty_like(source)
    for step in range(1, radius + 1):
        rest = max(len(keys) - step * stride, 0)
        added, part = np.uint32(step * step << INDEX_BITS), other[:rest]
        np.add(source[len(keys) - rest :], added, out=part)
        np.minimum(best[:rest], part, out=best[:rest])
        np.add(source[:rest], added, out=part)
        np.minimum(best[len(keys) - rest :], part, out=best[len(keys) - rest :])
    np.copyto(keys, best)
    keys[best >= beyond] = NOTHING_NEAR


def evidence_codes_on_host(
    states: UInt8[np.ndarray, "n"],
    keys: UInt32[np.ndarray, "n"],
    hit_sq: int,
    clear_sq: int,
    *,
    length: int,
) -> UInt8[np.ndarray, "length"]:
    """The cells of the map in `scoring.evidence_codes`, bit for bit.

    Args:
        states: Flat states of the map.
        keys: Keys that `nearest_field_on_host` gives, in the order of the states.
        hit_sq: Squared distance [voxel^2] up to which something occupied is a hit.
        clear_sq: Squared distance [voxel^2] from which on a free voxel is well clear of anything occupied.
        length: Length of the result; what follows the states is 0 and takes no memory.
    """
    codes = reserve(length, dtype=np.uint8)
    # The squared distance is what the highest bits of a key hold, so that keys are compared as they are.
    farthest_hit, nearest_clear = ((hit_sq + 1) << INDEX_BITS) - 1, clear_sq << INDEX_BITS

    def fill(start: int) -> None:
        part = slice(start, min(start + SLAB, len(states)))
        is_hit, is_free = keys[part] <= farthest_hit, states[part] == FREE
        if is_free.any():
            # In bytes: arithmetic on them runs 64 at a time.
            code = np.where(keys[part] >= nearest_clear, CONFLICT, NEUTRAL)
            code *= is_free
            np.putmask(code, is_hit, HIT)
        else:
            code = is_hit.view(np.uint8) * HIT
        # Pages on which nothing is known stay as the system gives them.
        if code.any():
            codes[part] = code

    spread(fill, range(0, len(states), SLAB))
    return codes
