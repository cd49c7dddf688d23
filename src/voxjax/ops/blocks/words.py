"""Grids of bits: 32 voxels along z in one uint32, and which of them lie in occupied blocks of 8 x 8 x 8 voxels.

Words are stored with a margin of empty ones, one block (8 words) below and above along x and y and one word along z,
so that a block is cut out together with its halo in one piece wherever it lies. Bit b of word (8 + x, 8 + y, 1 + w) is
voxel (x, y, 32 w + b). A word covers four blocks, a byte each: blocks are found from an eighth of the grid's bytes.
"""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, UInt8, UInt32

from ..._runtime.forks import refused_after_fork
from ..._types import Array
from ..bits import WORD, pack_bits

Occupied = Bool[Array, "x y z"] | UInt8[Array, "x y z"]
Words = UInt32[Array, "mx my mz"]

BLOCK = 8
"""Edge of a block [voxel]: a byte of a word; also the margin along x and y."""


@refused_after_fork
def pack_words(occupied: Occupied) -> Words:
    """Pack a grid into words of 32 voxels along z, with a margin.

    Args:
        occupied: True (or not 0) where a voxel is occupied. A host array is packed on the host, which reads it
            where it lies; what comes back is then a host array, too.

    Returns:
        uint32 (8 ceil(x / 8) + 16, 8 ceil(y / 8) + 16, ceil(z / 32) + 2).
    """
    if not isinstance(occupied, np.ndarray):
        return _pack(occupied)
    x, y, _ = occupied.shape
    packed = np.packbits(occupied, axis=2, bitorder="little")
    # The bytes of `packbits` go where the words lie, the lowest first on any machine, hence the explicit byte order.
    words = np.zeros(_words_shape(occupied.shape), "<u4")
    # One word of margin along z, in bytes.
    margin = WORD // 8
    words.view(np.uint8)[BLOCK : BLOCK + x, BLOCK : BLOCK + y, margin : margin + packed.shape[2]] = packed
    return words.astype(np.uint32, copy=False)


@jax.jit
def _pack(occupied: Occupied) -> Words:
    """`pack_words` on the device."""
    x, y, z = occupied.shape
    whole = _words_shape(occupied.shape)
    num_words = whole[2] - 2
    rows = jnp.asarray(occupied)
    if z % WORD:
        rows = jnp.pad(rows, ((0, 0), (0, 0), (0, -z % WORD)))
    words = pack_bits(rows.reshape(-1)).reshape(x, y, num_words)
    # The margin is put around the words, which are an eighth of the bytes that the voxels take.
    return jnp.pad(words, ((BLOCK, whole[0] - BLOCK - x), (BLOCK, whole[1] - BLOCK - y), (1, 1)))


def _words_shape(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Shape of the words of a grid."""
    bx, by, bz = block_lattice(shape)
    return (bx + 2) * BLOCK, (by + 2) * BLOCK, bz * BLOCK // WORD + 2


def block_lattice(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Number of blocks along x, y, z of a grid's words: along z a multiple of four, some may lie past the grid."""
    x, y, z = shape
    return -(-x // BLOCK), -(-y // BLOCK), -(-z // WORD) * (WORD // BLOCK)


def lattice_of_words(words: Words) -> tuple[int, int, int]:
    """`block_lattice` of the grid that the words were packed from."""
    x, y, w = words.shape
    return x // BLOCK - 2, y // BLOCK - 2, (w - 2) * (WORD // BLOCK)


@jax.jit
def occupied_blocks(words: Words) -> Bool[Array, "bx by bz"]:
    """Say which blocks hold an occupied voxel; cost of one read of the words."""
    lattice = lattice_of_words(words)
    if 0 in lattice:
        return jnp.zeros(lattice, jnp.bool_)
    width = words.shape[1] * words.shape[2]
    # Words are joined along x first, where those of a plane lie in a row, then along y; only then are their bytes
    # looked at, one a block.
    rows = jnp.asarray(words)[BLOCK:-BLOCK].reshape(lattice[0], BLOCK, width)
    planes = functools.reduce(operator.or_, (rows[:, i] for i in range(BLOCK)))
    # Without the barrier XLA reads every word eight times over.
    planes = jax.lax.optimization_barrier(planes).reshape(lattice[0], *words.shape[1:])
    # The margin is cut off here: it is empty, and its blocks are none of the lattice.
    inner = planes[:, BLOCK:-BLOCK, 1:-1].reshape(*lattice[:2], BLOCK, words.shape[2] - 2)
    columns = functools.reduce(operator.or_, (inner[:, :, i] for i in range(BLOCK)))
    shifts = jnp.arange(0, WORD, BLOCK, dtype=jnp.uint32)
    return (((columns[..., None] >> shifts[None, None, None, :]) & np.uint32(255)) != 0).reshape(lattice)
