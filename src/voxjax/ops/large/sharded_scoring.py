"""Scores of poses against a map whose evidence codes lie on several devices; the voxels of the other map are on all.

Each device answers for the places that its own blocks hold, and the answers are added up over the devices.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Float32, UInt8

from ..._checks import InputError, check_count, check_type, shown
from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._runtime.placement import is_traced
from ..._types import Array
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.words import BLOCK
from ..evidence.lookup import Block, turn_columns
from ..evidence.scoring import HIT, CodeField
from .sharded_blocks import ShardedBlocks, shard_blocks
from .sharded_checks import as_array, check_finite, check_mesh, place_of, scored_lists


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

    def meets(self, T: jax.Array, middle: jax.Array, half: jax.Array) -> jax.Array:
        """Whether boxes, by middles and half sides (3, m), may reach what the part owns, under a pose."""
        part = self.table
        assert isinstance(part, ShardedBlocks)
        _, low, high = part.span[0]
        layer = np.int32(part.lattice[1] * part.lattice[2])
        first, last = low // layer, (high - 1) // layer + 1
        first, last = ((BLOCK * n).astype(jnp.float32) for n in (first, last))
        at = (turn_columns(T, middle)[0] + T[0, 3] - self.origin[0]) / self.voxel_size
        # A voxel more than they reach: rounding differs from that of a lookup.
        reach = turn_columns(jnp.abs(T), half)[0] / self.voxel_size + 1.0
        return (high > low) & (at + reach >= first) & (at - reach <= last)


@refused_after_fork
def shard_codes(codes: UInt8[Array, "flat"], block: Block, mesh: Mesh) -> ShardedCodes:
    """Cut the evidence codes of a map in blocks and lay the parts on the devices of a mesh.

    Args:
        codes: Pool of codes, as `score_poses` takes it; the same in all processes, as all that follows.
        block: Place and size of the map, with its table.
        mesh: Devices, as for `shard_blocks`.

    Raises:
        InputError: If the block has no table, or one that is too short, or the codes are not those of its rows, or as
            from `shard_blocks`.
    """
    check_type("block", block, Block, "make it with voxjax.ops.Block")
    check_mesh(mesh)
    (x, y, z), table = place_of(block)
    num_rows, flat = int(table.max(initial=0)) + 1, as_array(codes)
    if flat.dtype.kind not in "ui" or flat.ndim != 1 or len(flat) < num_rows * BLOCK_VOXELS:
        got = f"{flat.dtype} of shape {flat.shape}" if flat.ndim else shown(codes)
        raise InputError(
            f"codes must be a flat array of {num_rows * BLOCK_VOXELS} whole numbers or more, 512 for each row that "
            f"block.table names, got {got}; give those that were made with this block."
        )
    pool = flat[: num_rows * BLOCK_VOXELS].reshape(-1, BLOCK, BLOCK, BLOCK)
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
    which float32 numbers are added up. All devices have all points, in pieces that lie close together; each looks up
    the pieces that a pose brings between the layers of blocks along x that it owns.

    Args:
        codes: Map from `shard_codes`.
        points: Points of the other map in its own frame [m].
        weights: Weight of each point; 0 for padding.
        poses: Each maps the points into the frame of the block.
        batch_size: Poses handled together, but not on a CPU.

    Returns:
        For each pose the sums of the weights that hit, conflict, and are known but undecided, on all devices.

    Raises:
        InputError: If the codes are not from `shard_codes`, points, weights or poses have other shapes or, but for
            points of weight 0, numbers that are not finite, or `batch_size` is below 1.
    """
    check_type("codes", codes, ShardedCodes, "make them with voxjax.ops.shard_codes")
    batch_size = check_count("batch_size", batch_size, 1)
    points, weights, poses = scored_lists(points, weights, poses)
    # Without poses there is nothing that a device could answer.
    if len(poses) == 0:
        return jnp.zeros((0, 3), jnp.float32)
    # Poses beyond a batch are padding, which takes memory and time.
    batch_size = min(batch_size, bucket_size(len(poses), 8))
    # A loop over poses that are handled one by one leaves out pieces for each of them.
    is_cpu = codes.blocks.mesh.devices.flat[0].platform == "cpu"
    together = 1 if is_cpu else batch_size
    # Pieces of fewer points are met by fewer devices, but each is a step of a loop.
    piece = 4096
    if any(is_traced(values) for values in (points, weights, poses)):
        short = -len(points) % piece
        lists = jnp.pad(points, ((0, short), (0, 0))), jnp.pad(weights, (0, short))
        turned = jnp.pad(poses, ((0, -len(poses) % batch_size), (0, 0), (0, 0)))
    else:
        # From the host, where all processes have the same ones; in lengths of the ladder, so that others rarely compile
        # anything.
        lists = _in_pieces(np.asarray(points), np.asarray(weights), piece)
        check_finite("poses", np.asarray(poses))
        turned = pad_rows(np.asarray(poses), _padded_count(len(poses), batch_size, together))
    columns, shares = lists[0].reshape(-1, piece, 3).swapaxes(1, 2), lists[1].reshape(-1, piece)
    return _scores(codes, columns, shares, turned, together=together)[: len(poses)]


def _padded_count(count: int, batch_size: int, together: int) -> int:
    """Number of poses with padding: a rung of the ladder from a batch on that those handled together divide."""
    return together * bucket_size(-(-count // together), batch_size // together)


@partial(jax.jit, static_argnames=("together",))
def _scores(
    codes: ShardedCodes,
    columns: Float32[Array, "m 3 s"],
    weights: Float32[Array, "m s"],
    poses: Float32[Array, "k 4 4"],
    *,
    together: int,
) -> Float32[jax.Array, "k 3"]:
    """`score_in_shards` of pieces of points, by columns, so many poses together, which divide their number."""
    blocks, everywhere = codes.blocks, PartitionSpec()

    def on_part(part: ShardedBlocks, block: Block, *lists: jax.Array) -> jax.Array:
        columns, weights, poses = lists
        # The part stands where a table does: it knows which blocks are its own.
        own = _OwnBlock(block.dims, block.origin, block.voxel_size, part)  # pyright: ignore[reportArgumentType]
        field = CodeField(part.pool.reshape(-1), own)
        middle, half = _boxes_of(columns, weights)

        def add_pieces(some: jax.Array) -> jax.Array:
            is_met = jax.vmap(lambda T: own.meets(T, middle, half))(some).any(axis=0)
            # Those that are met first, in their order; the loop ends with them.
            order = jnp.argsort(~is_met, stable=True)

            def add(i: jax.Array, sums: jax.Array) -> jax.Array:
                each = partial(field.sums, points=columns[order[i]], weights=weights[order[i]])
                return sums + (each(some[0])[None] if together == 1 else jax.vmap(each)(some))

            start = jnp.zeros((together, 3), jnp.float32)
            return jax.lax.fori_loop(0, jnp.sum(is_met, dtype=jnp.int32), add, start)

        sums = jax.lax.map(add_pieces, poses.reshape(-1, together, 4, 4)).reshape(-1, 3)
        return jax.lax.psum(sums, part.mesh.axis_names)

    run = jax.shard_map(
        on_part,
        mesh=blocks.mesh,
        in_specs=(blocks.spec, *(everywhere,) * 4),
        out_specs=everywhere,
        # The check of varying axes would refuse loops that start from constants.
        check_vma=False,
    )
    return run(blocks, codes.block, *(jnp.asarray(values) for values in (columns, weights, poses)))


def _boxes_of(columns: jax.Array, weights: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Middles (3, m) and half sides of boxes around the points of each piece that have a weight; -inf without any."""
    counts = (weights != 0)[:, None]
    low = jnp.min(jnp.where(counts, columns, jnp.inf), axis=2).T
    high = jnp.max(jnp.where(counts, columns, -jnp.inf), axis=2).T
    is_some = low <= high
    return jnp.where(is_some, (low + high) / 2, 0.0), jnp.where(is_some, (high - low) / 2, -jnp.inf)


def _in_pieces(points: np.ndarray, weights: np.ndarray, piece: int) -> tuple[np.ndarray, np.ndarray]:
    """Points that have a weight, those of each piece close together, and their weights, padded by zeros."""
    rows = np.flatnonzero(weights)
    some = points[rows]
    # A piece with one place that is no number would be met by no pose, with all other points in it.
    check_finite("points", some)
    check_finite("weights", weights[rows])
    if len(rows) > piece:
        # Along a Morton curve through 32 cells a side: keys of 16 bits are sorted in one pass.
        low, side = some.min(axis=0), np.ptp(some, axis=0).max()
        cells = np.clip((some - low) * (32.0 / max(side, np.finfo(np.float32).tiny)), 0, 31).astype(np.uint8)
        spread = np.asarray(
            [sum((n >> bit & 1) << 3 * bit for bit in range(5)) for n in range(32)], np.uint16
        )
        keys = spread[cells[:, 0]] << 2 | spread[cells[:, 1]] << 1 | spread[cells[:, 2]]
        rows = rows[np.argsort(keys, kind="stable")]
        some = points[rows]
    length = bucket_size(len(rows), piece)
    return pad_rows(some, length), pad_rows(weights[rows], length)
