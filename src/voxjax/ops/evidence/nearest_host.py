"""The field of nearest voxels and its evidence codes on the host: slabs that stay in the cache of a core, side by side.

Nothing is compiled for a block of another size.
"""

import numpy as np
from jaxtyping import Int32, UInt8, UInt32

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
    # The list is in C order: the voxels of a plane are a slice of it, so slabs need no search.
    first = np.searchsorted(index[:, 0], np.arange(width + 1))
    # A gap after each row and each plane, so that steps along an axis never leave it.
    gapped = (height + radius, depth + radius)
    planes = max(SLAB // (gapped[0] * gapped[1]), 1)

    def spread_in_planes(start: int) -> None:
        end = min(start + planes, width)
        # The gaps hold nothing, and what spreads into them is left behind.
        keys = np.full((end - start, *gapped), NOTHING_NEAR)
        rows = slice(first[start], first[end])
        x, y, z = index[rows].T
        keys[x - start, y, z] = np.arange(rows.start, rows.stop, dtype=np.uint32)
        flat = keys.reshape(-1)
        # The order of axes does not matter; z and y come first, because their neighbours are in the slab.
        _spread_along(flat, 1, radius)
        _spread_along(flat, gapped[1], radius)
        block[start:end] = keys[:, :height, :depth]

    # Along x all planes are needed, so this pass cuts the block the other way, and begins when the first one has ended.
    columns = block.reshape(width, -1)
    across = max(SLAB // max(width, 1), 1)

    def spread_across_planes(start: int) -> None:
        # The steps of the pass work on a copy in one piece, which stays in the cache.
        part = np.ascontiguousarray(columns[:, start : start + across])
        _spread_along(part.reshape(-1), part.shape[1], radius)
        columns[:, start : start + across] = part

    spread(spread_in_planes, range(0, width, planes))
    spread(spread_across_planes, range(0, columns.shape[1], across))
    return field


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

    def fill(start: int) -> None:
        part = slice(start, min(start + SLAB, len(states)))
        squared = (keys[part] >> np.uint32(INDEX_BITS)).astype(np.uint8)
        # In bytes: arithmetic on them runs 64 at a time.
        code = np.where(squared >= np.uint8(clear_sq), CONFLICT, NEUTRAL)
        code *= states[part] == FREE
        np.putmask(code, squared <= np.uint8(hit_sq), HIT)
        codes[part] = code

    spread(fill, range(0, len(states), SLAB))
    return codes
