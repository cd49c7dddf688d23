"""Window counts and classes of a map whose blocks lie on several devices, without any exchange between them."""

from collections.abc import Callable
from functools import partial
from math import gcd

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import PartitionSpec
from jaxtyping import Bool, Int32, UInt8, UInt16, UInt32

from ..._checks import InputError
from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._types import Array
from ..bits import pack_bits
from ..blocks.counts import MAX_HALO, count_cubes
from ..blocks.words import BLOCK
from ..window.box import check_shift, check_size
from ..window.classes import check_min_change, classes_of_counts
from .sharded_blocks import ShardedBlocks, check_blocks


@refused_after_fork
def count_in_shards(blocks: ShardedBlocks, *, size: int = 7) -> UInt16[jax.Array, "listed 8 8 8"]:
    """`box_count` on the listed blocks of all parts.

    Args:
        blocks: Map from `shard_blocks`; what holds `blocks.value` is counted.
        size: Window edge [voxel]; odd, 1 to 15.

    Returns:
        uint16 in [0, size**3] for each voxel of each listed block, cut as `blocks.places` is; 0 in padding.

    Raises:
        InputError: If `blocks` is no map in parts, or `size` even, below 1 or above 15.
    """
    check_blocks(blocks)
    return _counts(blocks, size=check_size(size))


@partial(jax.jit, static_argnames=("size",))
def _counts(blocks: ShardedBlocks, *, size: int) -> UInt16[jax.Array, "listed 8 8 8"]:
    def count(words: jax.Array) -> jax.Array:
        return _counts_with_margin(words, size, 0)

    return _over_listed(blocks, count)


@refused_after_fork
def classes_in_shards(
    blocks: ShardedBlocks, min_change: Array | np.int32, *, size: int = 7, shift: int = 4
) -> UInt8[jax.Array, "listed 8 8 8"]:
    """`window_classes` on the listed blocks of all parts.

    Args:
        blocks: Map from `shard_blocks`; what holds `blocks.value` is occupied.
        min_change: int32 scalar: percentage from which a change (see `count_change`) is significant.
        size: Window edge [voxel]; odd, 1 to 15.
        shift: Voxels moved along each axis of a direction.

    Returns:
        uint8: 0 not occupied, 1 flat, 2 edge, 3 corner, cut as `blocks.places` is; 0 in padding.

    Raises:
        InputError: If `blocks` is no map in parts, `min_change` no whole number of int32, or `size` or `shift` are out
            of range, or reach farther than one block.
    """
    check_blocks(blocks)
    min_change, size, shift = check_min_change(min_change), check_size(size), check_shift(shift)
    if size // 2 + shift > MAX_HALO:
        raise InputError(
            f"size // 2 + shift must be at most {MAX_HALO} voxels, what a part has around its blocks, "
            f"got {size // 2 + shift}; take window_classes."
        )
    return _classes(blocks, min_change, size=size, shift=shift)


@partial(jax.jit, static_argnames=("size", "shift"))
def _classes(
    blocks: ShardedBlocks, min_change: Array | np.int32, *, size: int, shift: int
) -> UInt8[jax.Array, "listed 8 8 8"]:
    def classify(words: jax.Array, min_change: jax.Array) -> jax.Array:
        counts = _counts_with_margin(words, size, shift)
        is_occupied = _voxels(words)
        return jax.vmap(lambda some, held: classes_of_counts(some, held, min_change, shift))(
            counts, is_occupied
        )

    return _over_listed(blocks, classify, jnp.asarray(min_change, jnp.int32))


def _over_listed(blocks: ShardedBlocks, kernel: Callable[..., jax.Array], *values: jax.Array) -> jax.Array:
    """What a kernel makes of the bits around each listed block, part by part.

    Args:
        blocks: The map.
        kernel: From words uint32 (k, 24, 24), as those of `Blocks` with a halo of 8, and the values to (k, 8, 8, 8).
        values: The same for all parts.
    """

    def on_part(part: ShardedBlocks, *values: jax.Array) -> jax.Array:
        bits = _bits_of(part)
        # So many at once that what the kernel makes of them stays in the cache; lists have lengths of the ladder.
        together = gcd(part.places.shape[0], 256)

        def on_some(places: jax.Array) -> jax.Array:
            # Written down first: otherwise they would be put together for each voxel along z anew.
            words = materialized(lambda: _words_around(part, bits, places), part.span[0, 0] >= 0)
            return kernel(words, *values)

        found = jax.lax.map(on_some, part.places.reshape(-1, together, 3))
        return found.reshape(-1, BLOCK, BLOCK, BLOCK)

    run = jax.shard_map(
        on_part,
        mesh=blocks.mesh,
        in_specs=(blocks.spec, *(PartitionSpec() for _ in values)),
        out_specs=blocks.spec,
        # The check of varying axes would refuse loops that start from constants.
        check_vma=False,
    )
    return run(blocks, *values)


def _bits_of(part: ShardedBlocks) -> UInt32[jax.Array, "rows 16"]:
    """Which voxels of the pool hold the value that is listed: a byte a column along z, four columns a word."""
    is_held = part.pool == jnp.asarray(part.value, part.pool.dtype)
    return jnp.asarray(pack_bits(is_held.reshape(-1))).reshape(len(is_held), -1)


def _words_around(
    part: ShardedBlocks, bits: UInt32[jax.Array, "rows 16"], places: Int32[jax.Array, "k 3"]
) -> UInt32[jax.Array, "k 24 24"]:
    """Bits of blocks and of the 26 around each, one word a column along z."""
    steps = np.stack(np.meshgrid(*(np.arange(-1, 2, dtype=np.int32),) * 3, indexing="ij"), axis=-1)
    number = part.numbers_at(places[:, None, None, None, :] + jnp.asarray(steps)[None])
    rows = part.rows_of(number, number >= 0)
    # Words are looked up and bytes are joined: the other way round there are four times as many lookups.
    found = jax.lax.optimization_barrier(bits.at[rows].get(mode="promise_in_bounds"))
    columns = jax.lax.bitcast_convert_type(found, jnp.uint8).reshape(-1, 3, 3, 3, BLOCK, BLOCK)
    below, within, above = (columns[:, :, :, k].astype(jnp.uint32) for k in range(3))
    words = below | (within << np.uint32(BLOCK)) | (above << np.uint32(2 * BLOCK))
    return words.transpose(0, 1, 3, 2, 4).reshape(-1, 3 * BLOCK, 3 * BLOCK)


def _counts_with_margin(
    words: UInt32[jax.Array, "k 24 24"], size: int, shift: int
) -> UInt16[jax.Array, "k m m m"]:
    """Counts of blocks and of `shift` voxels around each."""
    reach, side = size // 2, BLOCK + 2 * shift
    # Voxels are counted four at a time; what is counted beyond the margin is cut off.
    edge = -(-side // 4) * 4
    first, width = BLOCK - shift - reach, edge + 2 * reach
    missing = max(first + width - words.shape[1], 0)
    rows = jnp.pad(words, ((0, 0), (0, missing), (0, missing)))[
        :, first : first + width, first : first + width
    ]
    counts = count_cubes(rows >> np.uint32(first), edge=edge, size=size)
    return jax.lax.optimization_barrier(counts[:, :side, :side, :side])


def _voxels(words: UInt32[jax.Array, "k 24 24"]) -> Bool[jax.Array, "k 8 8 8"]:
    """The bits of the blocks themselves."""
    inner = words[:, BLOCK : 2 * BLOCK, BLOCK : 2 * BLOCK, None]
    shifts = jnp.arange(BLOCK, 2 * BLOCK, dtype=jnp.uint32)
    return ((inner >> shifts[None, None, None, :]) & np.uint32(1)) != 0
