"""Grids of bits: 32 voxels along z in one uint32, and which of them lie in occupied blocks of 8 x 8 x 8 voxels.

Bit b of word (x, y, w) is voxel (x, y, 32 w + b); voxels past the end of the grid are 0. A word covers four blocks,
a byte each, so that the blocks of a grid are found from an eighth of its bytes.
"""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, UInt8, UInt32

from .._types import Array

Occupied = Bool[Array, "x y z"] | UInt8[Array, "x y z"]
Words = UInt32[Array, "x y w"]

BLOCK = 8
"""Edge of a block [voxel]: a byte of a word."""

WORD = 32
"""Voxels along z in a word."""

# Puts the lowest bits of four bytes next to each other into the top four bits; no two products meet, so no carries.
_GATHER_BITS = np.uint32(0x10204080)


def pack_words(occupied: Occupied) -> Words:
    """Pack a grid into words of 32 voxels along z.

    Args:
        occupied: True (or not 0) where a voxel is occupied. A host array is packed on the host, which reads it
            where it lies; what comes back is then a host array, too.

    Returns:
        uint32 (x, y, ceil(z / 32)).
    """
    if isinstance(occupied, np.ndarray):
        packed = np.packbits(occupied, axis=2, bitorder="little")
        words = -(-occupied.shape[2] // WORD)
        whole = np.zeros((*occupied.shape[:2], 4 * words), np.uint8)
        whole[:, :, : packed.shape[2]] = packed
        return whole.view("<u4").astype(np.uint32, copy=False)
    return _pack(occupied)


@jax.jit
def _pack(occupied: Occupied) -> Words:
    """`pack_words` on the device: four voxels by a multiplication, then eight such parts."""
    x, y, z = occupied.shape
    words = -(-z // WORD)
    is_occupied = jnp.asarray(occupied).astype(jnp.bool_)
    if z % WORD:
        is_occupied = jnp.pad(is_occupied, ((0, 0), (0, 0), (0, words * WORD - z)))
    parts = is_occupied.astype(jnp.uint8).reshape(x, y, words, 8, 4)
    fours = (jax.lax.bitcast_convert_type(parts, jnp.uint32) * _GATHER_BITS) >> np.uint32(28)
    places = jnp.arange(0, WORD, 4, dtype=jnp.uint32)
    return jnp.sum(fours << places[None, None, None, :], axis=3, dtype=jnp.uint32)


@functools.partial(jax.jit, static_argnames=("depth",))
def unpack_words(words: Words, *, depth: int) -> Bool[Array, "x y z"]:
    """The grid of `depth` voxels along z that `pack_words` made the words from."""
    x, y, count = words.shape
    bits = jnp.asarray(words)[..., None] >> jnp.arange(WORD, dtype=jnp.uint32)[None, None, None, :]
    return ((bits & np.uint32(1)) != 0).reshape(x, y, count * WORD)[:, :, :depth]


def block_lattice(words_shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Number of blocks along x, y, z that a grid of words (x, y, w) spans; the last ones may hang over its end."""
    x, y, w = words_shape
    return -(-x // BLOCK), -(-y // BLOCK), w * (WORD // BLOCK)


@jax.jit
def occupied_blocks(words: Words) -> Bool[Array, "bx by bz"]:
    """Say which blocks hold an occupied voxel; cost of one read of the words."""
    lattice = block_lattice(words.shape)
    x, y, w = words.shape
    pads = ((0, -x % BLOCK), (0, -y % BLOCK), (0, 0))
    whole = jnp.pad(jnp.asarray(words), pads) if x % BLOCK or y % BLOCK else jnp.asarray(words)
    rows = whole.reshape(lattice[0], BLOCK, lattice[1] * BLOCK * w)
    planes = functools.reduce(operator.or_, (rows[:, i] for i in range(BLOCK)))
    # Without the barrier XLA reads every word eight times over.
    planes = jax.lax.optimization_barrier(planes).reshape(lattice[0], lattice[1], BLOCK, w)
    columns = functools.reduce(operator.or_, (planes[:, :, i] for i in range(BLOCK)))
    shifts = jnp.arange(0, WORD, BLOCK, dtype=jnp.uint32)
    return (((columns[..., None] >> shifts[None, None, None, :]) & np.uint32(255)) != 0).reshape(lattice)
