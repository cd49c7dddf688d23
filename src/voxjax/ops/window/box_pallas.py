"""Window counts and classes as kernels for NVIDIA GPUs, written with Pallas for its Triton backend.

Counting reads the grid once and writes the counts once, 3 bytes per voxel. A lane holds a word of 4 voxels along z
(a byte each) for `_ROWS` rows and walks along x: bytes are added over y, then over z, at most 225, and a running sum
over x is kept in pairs of 16 bits. Neighbouring lanes read the same words, which the caches serve; nothing is shared
between lanes, so that the kernel needs neither padding nor shared memory.

Classifying reads the grid and, only where a block of voxels has an occupied one, 27 counts per voxel.

The backend is named explicitly, since what `pallas_call` chooses by itself differs between versions of JAX. It was run
in interpret mode and lowered for CUDA, but not yet measured on a GPU.

JAX has announced the end of the Triton backend. Nothing chooses these kernels by itself: the whole-array forms of `box`
and `classes` run on every device, and where the backend is missing `implementation="pallas"` says so. There is no
form for its successor, Mosaic GPU: a kernel for it can be lowered on a host without a GPU, but that backend loads whole
tiles, not elements at computed places, so that it needs another kernel, which nobody could run yet.
"""

import importlib
from collections.abc import Sequence
from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import pallas as pl

from ..._checks import InputError
from ..._runtime import placement
from ..._types import Array

_LANES = 128
"""Words that one program counts side by side, one a lane; Triton takes powers of two."""

_ROWS = 4
"""Rows along y that each lane carries: their windows share most of what is loaded."""

_STRETCH = 128
"""Planes along x of one program: the windows of its first plane cost size - 1 planes more."""

_VOXELS = 256
"""Voxels that one program classifies; a power of two."""

# Bytes and half words are added within words of 32 bits: masks of their bits.
_ONES, _LOW_SEVEN, _EVEN = np.uint32(0x01010101), np.uint32(0x7F7F7F7F), np.uint32(0x00FF00FF)
_LOW, _HIGH = np.uint32(0xFFFF), np.uint32(0xFFFF0000)


def box_count_pallas(occupied: Array, size: int, *, margin: int = 0, interpret: bool = False) -> jax.Array:
    """Counts of the windows of a grid and `margin` voxels around it.

    Args:
        occupied: bool or uint8 (x, y, z), not 0 where occupied. A bool grid is copied to uint8 first, and so is one
            whose last edge is no multiple of 4, which costs two thirds of the kernel's own traffic.
        size: Window edge [voxel]; odd, 1 to 15.
        margin: Voxels around the grid whose windows are counted too.
        interpret: Run it step by step on any device, to test it.

    Returns:
        uint16 counts (x + 2 margin, y + 2 margin, z + 2 margin).

    Raises:
        NotImplementedError: If there is no GPU and `interpret` is False, or this JAX has no Triton backend.
        InputError: If the counts are 2**31 or more.
    """
    words, side = _words(occupied), -(-margin // 4)
    counts = _count_words(words, size, margin, side, interpret)
    # Counts leave in whole words, so up to three of them stand before those of the margin.
    first = 4 * side - margin
    return counts[:, :, first : first + occupied.shape[2] + 2 * margin]


def window_classes_pallas(
    occupied: Array, min_change: Array | np.int32, size: int, shift: int, *, interpret: bool = False
) -> jax.Array:
    """Classes uint8 as `voxjax.ops.window.classes.window_classes`; arguments and errors as `box_count_pallas`."""
    side = -(-shift // 4)
    counts = _count_words(_words(occupied), size, shift, side, interpret)
    grid = jnp.asarray(occupied).astype(jnp.uint8)
    bound = jnp.asarray(min_change, jnp.int32).reshape(1)
    kernel = partial(
        _classify_kernel, shape=grid.shape, counts_shape=counts.shape, shift=shift, first=4 * side
    )
    classes = _call(
        kernel,
        jax.ShapeDtypeStruct((grid.size,), jnp.uint8),
        (-(-grid.size // _VOXELS),),
        interpret,
        (grid.reshape(-1), counts.reshape(-1), bound),
    )
    return classes.reshape(grid.shape)


def _words(occupied: Array) -> jax.Array:
    """Four voxels along z as the bytes of one uint32, the first lowest; zeros fill the last word."""
    # A word is one load and one addition for four voxels.
    grid = jnp.asarray(occupied).astype(jnp.uint8)
    if grid.shape[2] % 4:
        grid = jax.lax.pad(grid, np.uint8(0), [(0, 0, 0), (0, 0, 0), (0, -grid.shape[2] % 4, 0)])
    return jax.lax.bitcast_convert_type(grid.reshape(*grid.shape[:2], -1, 4), jnp.uint32)


def _count_words(words: jax.Array, size: int, margin: int, side: int, interpret: bool) -> jax.Array:
    """Counts (x + 2 margin, y + 2 margin, 4 (words + 2 side)) of packed voxels."""
    nx, ny, num_words = (n + 2 * m for n, m in zip(words.shape, (margin, margin, side), strict=True))
    # Places in the counts are int32.
    if 4 * nx * ny * num_words > 2**31 - 1:
        raise InputError(
            f"the kernel counts fewer than 2**31 windows, got {nx} x {ny} x {4 * num_words}: use tiles."
        )
    # A short grid is one stretch: a program would count planes beyond it for nothing.
    num_lanes, stretch = -(-ny // _ROWS) * num_words, min(_STRETCH, nx)
    kernel = partial(
        _count_kernel,
        shape=words.shape,
        counts_shape=(nx, ny, num_words),
        size=size,
        margin=margin,
        side=side,
        stretch=stretch,
    )
    pairs = _call(
        kernel,
        jax.ShapeDtypeStruct((2 * nx * ny * num_words,), jnp.uint32),
        (-(-num_lanes // _LANES), -(-nx // stretch)),
        interpret,
        (words.reshape(-1),),
    )
    return jax.lax.bitcast_convert_type(pairs, jnp.uint16).reshape(nx, ny, 4 * num_words)


def _count_kernel(words, pairs, *, shape, counts_shape, size, margin, side, stretch):
    """One stretch of x for `_LANES` words of `_ROWS` rows each; two counts leave in one uint32."""
    nx, ny, _ = counts_shape
    half, reach = size // 2, -(-(size // 2) // 4)
    lane = pl.program_id(0) * _LANES + jnp.arange(_LANES, dtype=jnp.int32)
    y, word = (
        jax.lax.div(lane, np.int32(counts_shape[2])) * _ROWS,
        jax.lax.rem(lane, np.int32(counts_shape[2])),
    )
    x_first = pl.program_id(1) * stretch

    def byte_sums(x: jax.Array) -> list[jax.Array]:
        """Sums over y and z in one plane, for each row; 0 outside the grid."""
        columns = []
        for offset in range(-reach, reach + 1):
            at = word - side + offset
            # The grid has no padding in memory: what lies beyond it is masked off and counts as empty.
            is_inside = (at >= 0) & (at < shape[2]) & (x >= 0) & (x < shape[0])
            loaded = []
            for row in range(-half, _ROWS + half):
                place = y - margin + row
                mask = is_inside & (place >= 0) & (place < shape[1])
                index = (x * shape[1] + place) * shape[2] + at
                loaded.append(_as_ones(_load(words, jnp.where(mask, index, 0), mask, np.uint32(0))))
            columns.append(_running(loaded, size))
        return [_sum_bytes([column[row] for column in columns], half, reach) for row in range(_ROWS)]

    # A plane enters the running sums, and the oldest of the ring leaves them. Even and odd bytes are kept apart, in
    # pairs of 16 bits: the sum over three axes no longer fits a byte.
    def step(k: jax.Array, state):
        ring, even, odd = state
        new, old = byte_sums(x_first + k + half - margin), ring[0]
        even = tuple(e + (n & _EVEN) - (o & _EVEN) for e, n, o in zip(even, new, old, strict=True))
        odd = tuple(s + _high_bytes(n) - _high_bytes(o) for s, n, o in zip(odd, new, old, strict=True))
        x = x_first + k
        for row in range(_ROWS):
            # The four counts go back to their order along z: those of bytes 0 and 1, then those of 2 and 3.
            first = (even[row] & _LOW) | jnp.left_shift(odd[row], np.uint32(16))
            second = jnp.right_shift(even[row], np.uint32(16)) | (odd[row] & _HIGH)
            mask = (k >= 0) & (x < nx) & (y + row < ny)
            index = 2 * ((x * ny + y + row) * counts_shape[2] + word)
            both = jnp.concatenate([first[:, None], second[:, None]], axis=1)
            place = index[:, None] + jax.lax.broadcasted_iota(jnp.int32, (_LANES, 2), 1)
            _store(pairs, place, both, jnp.broadcast_to(mask[:, None], (_LANES, 2)))
        return (*ring[1:], tuple(new)), even, odd

    nothing = (jnp.zeros(_LANES, jnp.uint32),) * _ROWS
    # The first size - 1 planes only fill the sums. Lanes that are masked off keep their own index: interpret mode
    # writes back what it read there, which must not undo what another lane writes.
    jax.lax.fori_loop(1 - size, stretch, step, ((nothing,) * size, nothing, nothing))


def _classify_kernel(occupied, counts, min_change, classes, *, shape, counts_shape, shift, first):
    """Classes of `_VOXELS` voxels in C order; without an occupied one among them, nothing else is read."""
    voxel = pl.program_id(0) * _VOXELS + jnp.arange(_VOXELS, dtype=jnp.int32)
    is_inside = voxel < shape[0] * shape[1] * shape[2]
    place = jnp.where(is_inside, voxel, 0)
    mask = _load(occupied, place, is_inside, np.uint8(0)) != 0

    def classify() -> jax.Array:
        row = jax.lax.div(place, np.int32(shape[2]))
        x, y = jax.lax.div(row, np.int32(shape[1])), jax.lax.rem(row, np.int32(shape[1]))
        corner = (x * counts_shape[1] + y) * counts_shape[2] + (place - row * shape[2]) + first - shift

        def count(dx: int, dy: int, dz: int) -> jax.Array:
            offset = ((1 + dx) * counts_shape[1] + 1 + dy) * counts_shape[2] + 1 + dz
            index = jnp.where(mask, corner + shift * offset, 0)
            return _load(counts, index, mask, np.uint16(0)).astype(jnp.int32)

        here = count(0, 0, 0)
        # The same comparison of whole numbers as `classes.steady_directions`, so that both forms give one result.
        percent = jnp.clip(_load(min_change, jnp.zeros(_VOXELS, jnp.int32), None, None), 0, 400_000)
        # The bound on the percentage keeps this product, for the largest count of 15**3, within int32.
        bound = percent * here
        steady = jnp.zeros(_VOXELS, jnp.int32)
        for dx, dy, dz in _directions():
            ahead, behind = count(dx, dy, dz), count(-dx, -dy, -dz)
            change = jnp.maximum(jnp.abs(ahead - here), jnp.abs(behind - here))
            steady += (100 * change < bound).astype(jnp.int32)
        return jnp.where(mask, jnp.where(steady >= 2, 1, 3 - steady), 0)

    any_occupied = jnp.max(mask.astype(jnp.int32)) > 0
    kinds = jax.lax.cond(any_occupied, classify, lambda: jnp.zeros(_VOXELS, jnp.int32))
    _store(classes, voxel, kinds.astype(jnp.uint8), is_inside)


def _as_ones(word: jax.Array) -> jax.Array:
    """1 in each byte that is not 0."""
    return jnp.right_shift(((word & _LOW_SEVEN) + _LOW_SEVEN) | word, np.uint32(7)) & _ONES


def _running(values: Sequence[jax.Array], size: int) -> list[jax.Array]:
    """Sums of `size` neighbours in a list; bytes neither overflow nor borrow."""
    sums = [sum(values[1:size], values[0])]
    for new, old in zip(values[size:], values, strict=False):
        sums.append(sums[-1] + new - old)
    return sums


def _sum_bytes(words: Sequence[jax.Array], half: int, reach: int) -> jax.Array:
    """For each byte of the middle word, the sum of the bytes from `half` before to `half` after it."""
    total = words[reach]
    for offset in (k for k in range(-half, half + 1) if k):
        word, byte = divmod(4 * reach + offset, 4)
        if byte == 0:
            total = total + words[word]
        else:
            # Four bytes that begin within a word are put together of the end of that one and the start of the next.
            low = jnp.right_shift(words[word], np.uint32(8 * byte))
            total = total + (low | jnp.left_shift(words[word + 1], np.uint32(32 - 8 * byte)))
    return total


def _high_bytes(word: jax.Array) -> jax.Array:
    """Second and fourth byte as two numbers of 16 bits."""
    return jnp.right_shift(word, np.uint32(8)) & _EVEN


def _directions() -> list[tuple[int, int, int]]:
    """One sense of each of the 13 directions of the lattice."""
    return [(x, y, z) for x, y, z in product((-1, 0, 1), repeat=3) if (x, y, z) > (0, 0, 0)]


def _load(ref, index: jax.Array, mask, other) -> jax.Array:
    """Elements of a flat array; `other` where the mask is False."""
    return _triton().load(ref.at[index], mask=mask, other=other)


def _store(ref, index: jax.Array, value: jax.Array, mask: jax.Array) -> None:
    """Write elements of a flat array where the mask is True."""
    _triton().store(ref.at[index], value, mask=mask)


def _triton():
    """The backend's module; JAX announced in 0.11 that it will go."""
    try:
        return importlib.import_module("jax.experimental.pallas.triton")
    except ImportError as error:
        raise NotImplementedError(
            f'implementation="pallas" needs the Triton backend of Pallas, which JAX {jax.__version__} lacks: use None.'
        ) from error


def _call(
    kernel, result, grid: tuple[int, ...], interpret: bool, arguments: Sequence[jax.Array]
) -> jax.Array:
    """Run a kernel over a grid of programs."""
    if interpret:
        return pl.pallas_call(kernel, out_shape=result, grid=grid, interpret=True)(*arguments)
    if placement.backend() != "gpu":
        raise NotImplementedError(
            f'implementation="pallas" needs a GPU, and JAX runs on {placement.backend()}: use None.'
        )
    # One lane per thread; no stages, since no load can be moved ahead of its index.
    params = _triton().CompilerParams(num_warps=_LANES // 32, num_stages=1)
    return pl.pallas_call(kernel, out_shape=result, grid=grid, compiler_params=params)(*arguments)
