"""Bits packed into words, on the device: what the kernels on words, blocks and lists of voxels start with."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, UInt8, UInt32

from .._types import Array

Bits = Bool[Array, "n"] | UInt8[Array, "n"]
"""A uint8 counts as set where it is not 0."""

WORD = 32
"""Bits in a word of `pack_bits`."""

SPREAD = 16
"""Bits in a word of `pack_spread`."""

# Puts the lowest bits of four bytes next to each other into the top four bits; no two products meet, so no carries.
# The factor's bits 28, 21, 14 and 7 move bits 0, 8, 16 and 24 to places 28 to 31.
GATHER_BITS = np.uint32(0x10204080)


def pack_bits(bits: Bits) -> UInt32[Array, "m"]:
    """Pack bits into words of 32, the first bit lowest, zeros appended to the last word.

    The words are those of `np.packbits(bits, bitorder="little")`, read as little-endian uint32.
    """
    # Each step closes the gaps of the one before: nibbles to bytes, bytes to half words, half words to words.
    pairs = pack_spread(bits, 2).reshape(-1, 2)
    nibbles_in_bytes = (pairs | (pairs >> np.uint32(4))) & np.uint32(0x00FF00FF)
    halves = (nibbles_in_bytes | (nibbles_in_bytes >> np.uint32(8))) & np.uint32(0xFFFF)
    return halves[:, 0] | (halves[:, 1] << np.uint32(SPREAD))


def pack_spread(bits: Bits, multiple: int = 1) -> UInt32[Array, "m"]:
    """Pack bits into words of 16, four in the low half of each byte; cheaper than whole words, and enough to count in.

    Bit 8 b + i of a word, i below 4, is bit 4 b + i of its sixteen.

    Args:
        bits: Bits in the order in which they shall be packed.
        multiple: Words of zeros are appended up to a multiple of it.
    """
    bits = jnp.asarray(bits)
    # Bytes are packed as they are: the comparison with 0 is done below, on four of them at once.
    is_bytes = bits.dtype == jnp.uint8
    if not is_bytes:
        bits = bits.astype(jnp.bool_)
    short = -len(bits) % (SPREAD * multiple)
    if short:
        bits = jnp.concatenate([bits, jnp.zeros(short, bits.dtype)])
    # A byte holds one bit here: four of them are read as one word, so that one product gathers four bits.
    fours = jax.lax.bitcast_convert_type(bits.astype(jnp.uint8).reshape(-1, 4), jnp.uint32)
    if is_bytes:
        # A byte that is not 0 carries into its highest bit; compared one by one, bytes take three times as long.
        fours = (((fours & np.uint32(0x7F7F7F7F)) + np.uint32(0x7F7F7F7F)) | fours) >> np.uint32(7)
        fours = fours & np.uint32(0x01010101)
    # Whatever the product left below bit 28 is shifted out, and four nibbles in a byte each are one word again.
    nibbles = ((fours * GATHER_BITS) >> np.uint32(28)).astype(jnp.uint8)
    return jax.lax.bitcast_convert_type(nibbles.reshape(-1, 4), jnp.uint32)
