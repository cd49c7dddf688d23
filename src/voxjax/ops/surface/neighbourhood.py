"""Listed voxels in the ball around each other, built once on the host, and sums over them.

A sum over the ball is a linear function of the weights of the voxels. The neighbour relation is symmetric, so its
transpose looks the same neighbours up, at mirrored offsets: both modes of differentiation gather, neither scatters.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32, UInt32

from ..._checks import InputError, check_odd_window
from ..._runtime.buckets import bucket_size
from ..._runtime.placement import on_host
from ..._runtime.tables import check_cells, reserve, table_length
from ..._runtime.threads import spread
from ..._types import Array
from .ball_sums import ball_offsets

MAX_SIZE = 7
"""Largest diameter: offsets of -3 to 3 take three bits an axis."""

_BITS, _MASK, _BIAS = 3, 7, 3
_ROW_SHIFT = 3 * _BITS
"""A word is the row of a neighbour, counted from 1, above the three offsets; a word of zeros is no neighbour."""

_DEPTH = 4
"""Neighbours of each of them that one step of a loop adds."""


class Neighbourhood(NamedTuple):
    """Neighbours of listed voxels, to be passed to compiled functions as an argument (it is too large a constant).

    Attributes:
        words: uint32 (strips, depth, lanes): neighbours of the voxels in each lane, the offset of a neighbour in the
            low 9 bits, its row + 1 above; 0 where there is none.
        first: int32 (pieces + 1,): the strips of each piece of the list, a piece being as long as there are lanes.
        place: int32 (length,): where each row of the list lies in the pieces; pieces of equally many neighbours take
            the fewest words.
    """

    words: UInt32[Array, "strips depth lanes"]
    first: Int32[Array, "ends"]
    place: Int32[Array, "length"]


def neighbourhood(
    index: Int32[np.ndarray, "n 3"], shape: tuple[int, int, int], *, size: int = 7
) -> Neighbourhood:
    """Find the listed voxels in the ball of diameter `size` around each listed voxel, itself included.

    Lists of similar length share compiled kernels: the tables have few shapes (`_runtime.tables`, `_runtime.buckets`).
    It takes about 4 bytes for each neighbour, and 4 for each cell of the grid while it runs.

    Args:
        index: Different voxels inside the grid; fast where they are sorted in C order.
        shape: Size of the grid [voxel].
        size: Diameter [voxel]; odd, at most 7.

    Returns:
        Device arrays.

    Raises:
        InputError: If the size is not odd or above 7, or voxels repeat or lie outside the grid, or there are 2^23 or
            more.
    """
    # Shortest list of voxels [rows]: small maps share one shape.
    smallest = 1 << 14
    # Voxels whose sums grow side by side: on a CPU few, whose ten sums stay in the cache of a core.
    lanes = 1024 if on_host() else 1 << 15
    # Voxels among which those with equally many neighbours are put side by side: near each other, or lookups miss.
    window = max(1 << 14, lanes)
    if check_odd_window("size", size) > MAX_SIZE:
        raise InputError(f"size must be at most {MAX_SIZE} voxels, got {size}.")
    rows = np.asarray(index, np.int32)
    if len(rows) >= 1 << (32 - _ROW_SHIFT):
        raise InputError(f"index must list fewer than {1 << (32 - _ROW_SHIFT)} voxels, got {len(rows)}.")
    if ((rows < 0) | (rows >= np.asarray(shape, np.int32))).any():
        raise InputError(f"index must hold voxels inside the grid of {tuple(shape)} voxels.")
    length = bucket_size(len(rows), max(smallest, 2 * lanes))

    half = size // 2
    # A gap after each row and each plane, and before the first: no step from a voxel meets one that is not there.
    gapped = np.asarray([(shape[1] + half) * (shape[2] + half), shape[2] + half, 1], np.int64)
    front = half * int(gapped.sum())
    cells = front + rows @ gapped
    table = reserve(2 * front + int(np.prod(np.asarray(shape, np.int64) + half)), dtype=np.uint32)
    table[cells] = np.arange(1, len(rows) + 1, dtype=np.uint32)
    # A voxel that is listed twice keeps the number of its last row, so that the first one reads another than its own.
    if np.count_nonzero(table[cells] == np.arange(1, len(rows) + 1, dtype=np.uint32)) != len(rows):
        raise InputError("index must list each voxel once.")

    offsets = ball_offsets(size)
    # Word of each step: its offset in nine bits, to which the row of the voxel met is added.
    codes = ((offsets + _BIAS) << (_BITS * np.arange(2, -1, -1))).sum(axis=1).astype(np.uint32)
    steps = offsets @ gapped

    def list_window(start: int) -> _Window:
        return _list_window(table, cells[start : start + window], steps, codes, lanes)

    return _lay_out(spread(list_window, range(0, len(rows), window)), window, lanes, length)


class _Window(NamedTuple):
    """Neighbours of some voxels.

    Attributes:
        words: Neighbours of the first voxel, then those of the next.
        target: Where each word belongs, counted from the first strip of the window.
        strips: Number of strips of each piece of the window.
        place: Where each voxel lies in the pieces of the window.
    """

    words: np.ndarray
    target: np.ndarray
    strips: np.ndarray
    place: np.ndarray


def _list_window(
    table: np.ndarray, cells: np.ndarray, steps: np.ndarray, codes: np.ndarray, lanes: int
) -> _Window:
    """Neighbours of the voxels in some cells; in pieces of about equally many, most first."""
    degree, words = np.zeros(len(cells), np.int64), []
    # Voxels looked up at once: what is found in between stays in the cache.
    together = 512
    codes_of_rows = np.tile(codes, together)
    for start in range(0, len(cells), together):
        rows = cells[start : start + together]
        found = table.take((rows[:, None] + steps[None, :]).reshape(-1))
        at = np.flatnonzero(found)
        bounds = np.searchsorted(at, np.arange(len(rows) + 1) * len(steps))
        degree[start : start + len(rows)] = np.diff(bounds)
        words.append((found[at] << np.uint32(_ROW_SHIFT)) | codes_of_rows[at])
    # A piece is as deep as its first voxel has neighbours: sorted by their number, the others waste little.
    order = np.argsort(-degree, kind="stable")
    place = np.empty(len(cells), np.int32)
    place[order] = np.arange(len(cells), dtype=np.int32)
    strips = -(-degree[order[::lanes]] // _DEPTH)
    before = np.concatenate([[0], np.cumsum(strips)])
    # The neighbours of a voxel follow each other in its lane, one `lanes` further on than the one before. The running
    # number below counts words of all voxels, so those of the voxels before are taken off.
    start = before[place // lanes] * _DEPTH * lanes + place % lanes - (np.cumsum(degree) - degree) * lanes
    target = np.repeat(start, degree) + np.arange(degree.sum()) * lanes
    return _Window(np.concatenate(words), target, strips, place)


def _lay_out(windows: list[_Window], window: int, lanes: int, length: int) -> Neighbourhood:
    """One table of all windows."""
    strips = np.concatenate([np.zeros(1, np.int64), *(part.strips for part in windows)])
    # Pieces of padding begin and end behind the last strip: they have nothing to add.
    first = np.full(length // lanes + 1, strips.sum(), np.int32)
    first[: len(strips)] = np.cumsum(strips)
    of_strip = _DEPTH * lanes
    num_words = int(strips.sum()) * of_strip
    check_cells(num_words, 0, "the neighbourhood of all voxels", "take a smaller window, or fewer voxels")
    num_strips = table_length(num_words) // of_strip
    # Words that are not written are zeros, and a word of zeros is no neighbour.
    flat = reserve(num_strips * of_strip, dtype=np.uint32)
    # Rows of padding stay in their place, where sums are 0.
    place = np.arange(length, dtype=np.int32)

    def write(number: int) -> None:
        part, start = windows[number], number * window
        flat[part.target + int(first[start // lanes]) * of_strip] = part.words
        place[start : start + len(part.place)] = part.place + np.int32(start)

    spread(write, range(len(windows)))
    words = flat.reshape(num_strips, _DEPTH, lanes)
    return Neighbourhood(*(jax.device_put(a) for a in (words, first, place)))


@jax.jit
def ball_sums(weights: Float[Array, "m"], neighbours: Neighbourhood) -> Float[Array, "10 m"]:
    """Sums of 1, x, y, z, xx, yy, zz, xy, xz, yz over the neighbours of each voxel, times their weights.

    x, y, z count from the voxel [voxel]. Linear in the weights, in their dtype; differentiable in both modes.

    Args:
        weights: Weights of the listed voxels, in their order, and of as many rows after them as the list is padded
            with; at most as many as `neighbours.place`.
        neighbours: Neighbours in the list, see `neighbourhood`.
    """
    weights = jnp.asarray(weights)
    num_rows, length = weights.shape[0], neighbours.place.shape[0]
    padded = jnp.pad(weights, (0, length - num_rows))
    sums, back = partial(_sums, neighbours), partial(_transposed_sums, neighbours)

    # With L for the sums, the system A (p, q, r) = b whose inverse is (b0 + L^T b1, L b0 + b2, b1) is symmetric, and
    # JAX knows how to differentiate and to transpose the solution of such a system, in both modes, and to batch it.
    # What of it is not asked for, as L^T b1 here, is not computed. One array, for JAX 0.10 fails on missing cotangents.
    def solve(_, right: Array) -> Array:
        b0, b1, b2 = right[0], right[1:11], right[11:]
        return jnp.concatenate([(b0 + back(b1))[None], sums(b0) + b2, b1])

    def multiply(values: Array) -> Array:
        p, q, r = values[0], values[1:11], values[11:]
        b0 = p - back(r)
        return jnp.concatenate([b0[None], r, q - sums(b0)])

    right = jnp.concatenate([padded[None], jnp.zeros((20, length), weights.dtype)])
    return jax.lax.custom_linear_solve(multiply, right, solve, symmetric=True)[1:11, :num_rows]


def _sums(neighbours: Neighbourhood, weights: Float[Array, "length"]) -> Float[Array, "10 length"]:
    """The sums, piece by piece."""
    # Rows count from 1: what is no neighbour looks up this 0, and needs no mask.
    table = jnp.concatenate([jnp.zeros(1, weights.dtype), weights])

    def look(strip: Array) -> tuple[Array, Array]:
        words = jax.lax.dynamic_index_in_dim(neighbours.words, strip, keepdims=False)
        return words, _take(table, words)

    def add(strip: Array, carry: tuple[tuple[Array, ...], tuple[Array, Array]]):
        # The weights were looked up a step ago: so each is read once, and not again for each of the ten sums.
        totals, (words, found) = carry
        for word, weight in zip(words, found, strict=True):
            parts = (weight, *(weight * term for term in _monomials(word, weight.dtype)))
            totals = tuple(total + part for total, part in zip(totals, parts, strict=True))
        # After the last strip of a piece one more is looked up, of the next piece or, at the end of the table, that one
        # again; it is not added.
        return totals, look(strip + 1)

    def sum_piece(ends: tuple[Array, Array]) -> Array:
        nothing = tuple(jnp.zeros(neighbours.words.shape[2], weights.dtype) for _ in range(10))
        return jnp.stack(jax.lax.fori_loop(*ends, add, (nothing, look(ends[0])))[0])

    pieces = jax.lax.map(sum_piece, (neighbours.first[:-1], neighbours.first[1:]))
    return _take(jnp.moveaxis(pieces, 0, 1).reshape(10, -1), neighbours.place)


def _transposed_sums(neighbours: Neighbourhood, sums: Float[Array, "10 length"]) -> Float[Array, "length"]:
    """The transpose: what a voxel adds to the sums of its neighbours, which see it at the mirrored offset."""
    columns = [jnp.concatenate([jnp.zeros(1, sums.dtype), row]) for row in sums]

    def add(strip: Array, total: Array) -> Array:
        for word in jax.lax.dynamic_index_in_dim(neighbours.words, strip, keepdims=False):
            one, x, y, z, xx, yy, zz, xy, xz, yz = (_take(column, word) for column in columns)
            u, v, w = _monomials(word, sums.dtype)[:3]
            # The neighbour sees the voxel at the mirrored offset: x, y and z change their sign, products
            # of two keep theirs.
            total = total + (
                one + u * (u * xx + v * xy + w * xz - x) + v * (v * yy + w * yz - y) + w * (w * zz - z)
            )
        return total

    def sum_piece(ends: tuple[Array, Array]) -> Array:
        return jax.lax.fori_loop(*ends, add, jnp.zeros(neighbours.words.shape[2], sums.dtype))

    pieces = jax.lax.map(sum_piece, (neighbours.first[:-1], neighbours.first[1:]))
    return _take(pieces.reshape(-1), neighbours.place)


def _take(table: Array, words_or_places: Array) -> jax.Array:
    """Entries of the last axis at the rows of words (unsigned), or at places."""
    is_word = words_or_places.dtype == jnp.uint32
    at = (words_or_places >> np.uint32(_ROW_SHIFT)).astype(jnp.int32) if is_word else words_or_places
    return jnp.asarray(table).at[..., at].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _monomials(words: Array, dtype: np.dtype) -> tuple[Array, ...]:
    """x, y, z, xx, yy, zz, xy, xz, yz of the offsets in words."""
    x, y, z = (
        ((words >> np.uint32(_BITS * k)) & np.uint32(_MASK)).astype(jnp.int32) - np.int32(_BIAS)
        for k in (2, 1, 0)
    )
    return tuple(term.astype(dtype) for term in (x, y, z, x * x, y * y, z * z, x * y, x * z, y * z))
