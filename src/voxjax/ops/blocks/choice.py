"""`box_count` at listed voxels, by the whole grid or by the blocks that the voxels lie in."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Int32, UInt16

from ..._checks import InputError, check_choice, check_odd_window
from ..._runtime.buckets import bucket_size
from ..._runtime.forks import refused_after_fork
from ..._runtime.placement import on_host
from ..._types import Array
from ..window.classes import MAX_SIZE, box_count
from .counts import count_in_blocks, cut_blocks, take_from_blocks
from .words import Occupied, Words, block_lattice, pack_words

MAX_BLOCK_SHARE = 0.12
"""Share of a grid's blocks up to which counting at voxels is faster in blocks, the packing of the grid included.

Chosen between the shares 10 %, where blocks took less time than the whole grid, and 20 %, where they took more: 256
cubed, bool on the device, two cores, default allocator and huge pages. `python -m bench kernels --only blocks`
measures it again.
"""

MIN_VOXELS = 1 << 24
"""Smallest grid that is counted in blocks: smaller ones stay in the caches, which helps the dense way."""


@refused_after_fork
def box_count_at(
    occupied: Occupied, index: Int32[Array, "n 3"], *, size: int = 7, implementation: str | None = None
) -> UInt16[Array, "n"]:
    """`box_count` at listed voxels only: what most callers want of it.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        index: Voxels inside the grid, occupied or not; rows may repeat.
        size: Window edge [voxel]; odd, 1 to 15.
        implementation: "dense": the whole grid, then the listed voxels; "blocks": the blocks that the listed voxels
            lie in, cut from the grid's bits; host code, as it reads back how many they are. None takes "blocks" from
            `MIN_VOXELS` voxels on, up to a share of `MAX_BLOCK_SHARE` of the blocks of the grid; under `jax.jit`,
            where the share is not known, "dense".

    Returns:
        uint16 in [0, size**3], in the order of `index`; both ways give the same.

    Raises:
        InputError: If `size` is no window size or the implementation is unknown, or "blocks" under `jax.jit`.
    """
    size = check_odd_window("size", size)
    if size > MAX_SIZE:
        raise InputError(f"size must be at most {MAX_SIZE} voxels, got {size}.")
    if implementation is not None:
        check_choice("implementation", implementation, ("dense", "blocks"))
    is_traced = isinstance(occupied, Tracer) or isinstance(index, Tracer)
    if is_traced and implementation == "blocks":
        raise InputError(
            'implementation "blocks" must know how many blocks there are, which jax.jit hides: '
            'take "dense", or cut_blocks with a capacity.'
        )
    if 0 in occupied.shape or index.shape[0] == 0:
        return jnp.zeros((index.shape[0],), jnp.uint16)
    is_small = occupied.size < MIN_VOXELS
    if implementation == "dense" or (implementation is None and (is_traced or is_small)):
        return _dense_at(occupied, index, size=size)
    # Only the voxels asked for say how many blocks it takes: the number is read back, for it decides the way and the
    # length of the list.
    flags = _blocks_of(index, lattice=block_lattice(occupied.shape))
    count = int(jnp.sum(flags, dtype=jnp.int32))
    if implementation is None and count > MAX_BLOCK_SHARE * flags.size:
        return _dense_at(occupied, index, size=size)
    # The list is as long as a rung of the ladder, so that another number of blocks rarely compiles anything.
    blocks = cut_blocks(_packed(occupied), flags, halo=size // 2, capacity=bucket_size(count))
    return take_from_blocks(count_in_blocks(blocks, size=size), blocks, index, lattice=flags.shape)[0]


def _packed(occupied: Occupied) -> Words:
    """Words of the grid; one that a CPU holds is packed where it lies by NumPy, which is faster than XLA."""
    return pack_words(np.asarray(occupied) if on_host(occupied) else occupied)


@partial(jax.jit, static_argnames=("size",))
def _dense_at(occupied: Occupied, index: Int32[Array, "n 3"], *, size: int) -> UInt16[Array, "n"]:
    """Counts of the whole grid, then those asked for."""
    counts = box_count(occupied, size=size)
    return counts[index[:, 0], index[:, 1], index[:, 2]]


@partial(jax.jit, static_argnames=("lattice",))
def _blocks_of(index: Int32[Array, "n 3"], *, lattice: tuple[int, int, int]) -> Bool[Array, "bx by bz"]:
    """Say which blocks hold a listed voxel."""
    block = jnp.asarray(index) >> np.int32(3)
    place = (block[:, 0] * np.int32(lattice[1]) + block[:, 1]) * np.int32(lattice[2]) + block[:, 2]
    # Many voxels write one flag, and all write True: no order of the writes matters.
    flags = jnp.zeros((lattice[0] * lattice[1] * lattice[2],), jnp.bool_).at[place].set(True, mode="drop")
    return flags.reshape(lattice)
