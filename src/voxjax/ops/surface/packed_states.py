"""States of a grid as one bit a voxel, packed along z so that one word holds all that a window needs of one column.

Around the grid lies an empty margin, so that no window asks for what is not there.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int32, UInt8, UInt32

from ..._checks import InputError
from ..._runtime.tables import check_cells, reserve, table_length
from ..._runtime.threads import spread
from ..._types import FREE, OCCUPIED, Array
from ..bits import GATHER_BITS

GROUP = 8
"""Voxels along z that share a word."""
SHARED_MARGIN = 4
MAX_MARGIN = 12
"""Largest reach along z [voxel] with both states in one word, and at all: 8 + 2 * reach bits must fit."""
_SLAB = 1 << 20
"""Cells that the host packs at once: what it writes in between stays in the cache of a core."""


class PackedStates(NamedTuple):
    """States of a block with a margin, packed along z.

    Attributes:
        words: uint32 (k, groups): bit i of a word is the voxel i places after the first one of its group. One row:
            occupied in the low 16 bits, free in the high ones; two rows: occupied, free.
        height: int32: voxels of the block along y.
        depth: int32: groups of the block along z.
    """

    words: UInt32[Array, "k groups"]
    height: Int32[Array, ""]
    depth: Int32[Array, ""]

    def steps(self, x: Array, y: Array) -> Array:
        """Groups between two voxels that are x and y apart, int32."""
        return (x * self.height + y) * self.depth

    def place(self, voxels: Int32[Array, "3 n"], *, margin: int) -> tuple[Array, Array]:
        """The word of each voxel's own column that holds the voxel `margin` below it, int32, and its bit, uint32."""
        x, y, z = voxels
        # The empty groups before a column are counted in: what lies below its first voxel has its place in them.
        below = z + np.int32(GROUP * _empty_groups(margin) - margin)
        group = self.steps(x + np.int32(margin), y + np.int32(margin)) + below // GROUP
        return group, (below % GROUP).astype(jnp.uint32)

    def look(self, group: Array, shift: Array) -> tuple[Array, Array]:
        """Bits of the occupied and of the free voxels from `shift` voxels after the start of a group on, uint32."""
        # The margin holds all that a window asks for, so bounds are not looked at again.
        found = [
            row.at[group].get(mode="promise_in_bounds", wrap_negative_indices=False) >> shift
            for row in self.words
        ]
        # Above the bits of a window lie those of other voxels, or of the other state: whoever asked masks them off.
        return (found[0], found[0] >> 16) if len(found) == 1 else (found[0], found[1])


def pack_states(states: UInt8[Array, "x y z"], *, margin: int) -> PackedStates:
    """Pack states on the device; works under every transformation that the states are under.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        margin: How far a window reaches [voxel].

    Raises:
        InputError: If the margin is above 12.
    """
    shape = _packed_shape(states.shape, margin)
    front = GROUP * _empty_groups(margin)
    widths = [(margin, margin), (margin, margin), (front, GROUP * shape[2] - front - states.shape[2])]
    # Four states are read as one word, a bit of each is gathered by one product; two such nibbles are a group.
    flat = jnp.pad(states.astype(jnp.uint8), widths).reshape(-1, 4)
    # States 1 and 2, free and occupied, are bits 0 and 1 of their byte, so that a shift brings either to bit 0.
    quads = jax.lax.bitcast_convert_type(flat, jnp.uint32)
    nibbles = [
        (((quads >> np.uint32(state >> 1)) & np.uint32(0x01010101)) * GATHER_BITS) >> np.uint32(28)
        for state in (OCCUPIED, FREE)
    ]
    occupied, free = (pairs[0::2] | pairs[1::2] << np.uint32(4) for pairs in nibbles)
    # A window begins at one of 8 bits and has 2 * margin + 1 of them: its own group and one more hold it up to a margin
    # of 4, its own and three more up to one of 12.
    if margin <= SHARED_MARGIN:
        words = _with_next((occupied | free << np.uint32(16))[None], 1)
    else:
        words = _with_next(jnp.stack([occupied, free]), 3)
    return PackedStates(words, np.asarray(shape[1], np.int32), np.asarray(shape[2], np.int32))


def pack_on_host(states: UInt8[np.ndarray, "x y z"], *, margin: int) -> PackedStates:
    """`pack_states` in NumPy, into a table of few lengths: kernels that look things up in it serve grids of any shape.

    Raises:
        InputError: If the margin is above 12.
    """
    shape = _packed_shape(states.shape, margin)
    num_words, front = int(np.prod(shape)), _empty_groups(margin)
    length = table_length(num_words, (1 << 25) // GROUP)
    num_rows = 1 if margin <= SHARED_MARGIN else 2
    words = reserve(num_rows * length, dtype=np.uint32).reshape(num_rows, length)
    # The memory is zero where nothing is written, and so is the margin.
    planes = words[:, :num_words].reshape(num_rows, shape[0], shape[1] * shape[2])
    inner = slice(margin * shape[2], (margin + states.shape[1]) * shape[2])
    step = max(_SLAB // max(states[0].size, 1), 1) if len(states) else 1

    def pack_slab(start: int) -> None:
        slab = states[start : start + step]
        groups = np.zeros((2, *slab.shape[:2], shape[2]), np.uint8)
        for row, state in zip(groups, (OCCUPIED, FREE), strict=True):
            is_state = slab == state
            # To look takes less time than to pack, and many maps, or parts of them, have no free space.
            if is_state.any():
                row[..., front:] = np.packbits(is_state, axis=-1, bitorder="little")
        # Columns in a row: what follows the last group of one are the empty groups of the next.
        occupied, free = groups.reshape(2, len(slab), -1).astype(np.uint32)
        own = np.stack([occupied | free << np.uint32(16)] if num_rows == 1 else [occupied, free])
        # A word holds its own group and those that follow: what a window needs of a column never straddles two words.
        packed = own.copy()
        for follower in range(1, 2 if num_rows == 1 else 4):
            packed[..., :-follower] |= own[..., follower:] << np.uint32(GROUP * follower)
        planes[:, margin + start : margin + start + len(slab), inner] = packed

    spread(pack_slab, range(0, len(states), step))
    # Height and depth are arrays, and so no part of a kernel's shapes: grids of all shapes share one.
    return PackedStates(words, np.asarray(shape[1], np.int32), np.asarray(shape[2], np.int32))


def _empty_groups(margin: int) -> int:
    """Groups before the first voxel of a column; they are what comes after the last one of the column before."""
    return -(-margin // GROUP)


def _packed_shape(shape: tuple[int, ...], margin: int) -> tuple[int, int, int]:
    """Voxels along x and y and groups along z of the block with its margin."""
    if margin > MAX_MARGIN:
        raise InputError(
            f"size must be at most {2 * MAX_MARGIN + 1} voxels and reach at most {MAX_MARGIN}, got a window that "
            f"reaches {margin} voxels; take a smaller window or a coarser grid."
        )
    packed = shape[0] + 2 * margin, shape[1] + 2 * margin, -(-shape[2] // GROUP) + _empty_groups(margin)
    num_groups = packed[0] * packed[1] * packed[2]
    check_cells(num_groups, 0, "packed states", "crop the grid, or work tile by tile")
    return packed


def _with_next(words: Array, count: int) -> Array:
    """Words with the bits of the `count` groups that follow above their own."""
    padded = jnp.pad(words, ((0, 0), (0, count)))
    length = words.shape[1]
    for k in range(1, count + 1):
        words = words | padded[:, k : k + length] << np.uint32(GROUP * k)
    return words
