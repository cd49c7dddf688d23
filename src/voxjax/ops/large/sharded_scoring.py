"""Scores of poses against a map whose evidence codes lie on several devices; the voxels of the other map are on all.

Each device answers for the places that its own blocks hold, and the answers are added up over the devices.
"""

from functools import partial
from math import prod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Float32, UInt8

from ..._checks import InputError
from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._runtime.placement import is_traced
from ..._types import Array
from ..blocks.block_array import BlockArray, lattice_shape
from ..blocks.words import BLOCK
from ..evidence.lookup import Block
from ..evidence.scoring import HIT, CodeField
from .sharded_blocks import ShardedBlocks, shard_blocks


class ShardedCodes(eqx.Module):
    """Evidence codes of a map in parts, one a device, and where they lie.

    Attributes:
        blocks: The codes.
        block: Place and size of the map; its table is that of the parts.
    """

    blocks: ShardedBlocks
    block: Block


class _OwnBlock(Block):
    """`Block` as one part sees it: what other parts own is in the row of zeros, where nothing is known."""

    def rows_of(self, block: Array) -> jax.Array:
        part = self.table
        assert isinstance(part, ShardedBlocks)
        _, low, high = part.span[0]
        return part.rows_of(jnp.asarray(block), (block >= low) & (block < high))


@refused_after_fork
def shard_codes(codes: UInt8[Array, "flat"], block: Block, mesh: Mesh) -> ShardedCodes:
    """Cut the evidence codes of a map in blocks and lay the parts on the devices of a mesh.

    Args:
        codes: Pool of codes, as `score_poses` takes it; the same in all processes, as all that follows.
        block: Place and size of the map, with its table.
        mesh: Devices, as for `shard_blocks`.

    Raises:
        InputError: If the block has no table, or as from `shard_blocks`.
    """
    if block.table is None:
        raise InputError("block must have a table of blocks, as that of a prepared map; got a dense field.")
    x, y, z = (int(n) for n in np.asarray(block.dims))
    lattice = lattice_shape((x, y, z))
    table = np.asarray(block.table)[: prod(lattice)].reshape(lattice)
    pool = np.asarray(codes).reshape(-1, BLOCK, BLOCK, BLOCK)[: int(table.max(initial=0)) + 1]
    # Parts hold equally many blocks at surfaces.
    blocks = shard_blocks(BlockArray(table, pool, (x, y, z)), mesh, value=int(HIT))
    place = (np.asarray(value) for value in (block.dims, block.origin, np.float32(block.voxel_size)))
    return ShardedCodes(blocks, Block(*place))


@refused_after_fork
def score_in_shards(
    codes: ShardedCodes,
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    poses: Float32[Array, "k 4 4"],
    *,
    batch_size: int = 8,
) -> Float32[jax.Array, "k 3"]:
    """`score_poses` against a map in parts: weighted hits, conflicts and undecided of many poses.

    Sums of whole weights that stay below 2**24 are those of `score_poses` to the bit; others differ by the order in
    which float32 numbers are added up. The pool is shared out, the work is not: each device looks where each point
    lies under each pose.

    Args:
        codes: Map from `shard_codes`.
        points: Points of the other map in its own frame [m].
        weights: Weight of each point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        batch_size: Poses handled together.

    Returns:
        For each pose the sums of the weights that hit, conflict, and are known but undecided, on all devices.
    """
    lists = points, weights, poses
    if not any(is_traced(values) for values in lists):
        # Lists of the ladder's lengths, so that others rarely compile anything; from the host, where all processes have
        # the same ones.
        lists = tuple(
            pad_rows(np.asarray(values, np.float32), bucket_size(len(values), smallest))
            for values, smallest in zip(lists, (1 << 10, 1 << 10, batch_size), strict=True)
        )
    return _scores(codes, *lists, batch_size=batch_size)[: len(poses)]


@partial(jax.jit, static_argnames=("batch_size",))
def _scores(
    codes: ShardedCodes, points: Array, weights: Array, poses: Array, *, batch_size: int
) -> Float32[jax.Array, "k 3"]:
    """`score_in_shards` of lists of any length."""
    blocks, everywhere = codes.blocks, PartitionSpec()

    def on_part(part: ShardedBlocks, block: Block, columns: Array, weights: Array, poses: Array) -> jax.Array:
        # The part stands where a table does: it knows which blocks are its own.
        own = _OwnBlock(block.dims, block.origin, block.voxel_size, part)  # pyright: ignore[reportArgumentType]
        field = CodeField(part.pool.reshape(-1), own)
        sums = jax.lax.map(lambda T: field.sums(T, columns, weights), poses, batch_size=batch_size)
        return jax.lax.psum(sums, part.mesh.axis_names)

    run = jax.shard_map(
        on_part,
        mesh=blocks.mesh,
        in_specs=(blocks.spec, *(everywhere,) * 4),
        out_specs=everywhere,
        # The check of varying axes would refuse loops that start from constants.
        check_vma=False,
    )
    return run(blocks, codes.block, points.T, weights, poses)
