"""One map in blocks over many devices: each holds as many blocks of content, whatever part of the box they span.

A part has a pool of its own, with copies of the blocks that touch its own ones, so that kernels which look at
neighbourhoods exchange nothing; and a piece of the table of the box, so that a lookup is two reads as on one device.
It works alike on the devices of one process and of many processes that `jax.distributed` has joined.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Bool, Int32, Shaped

from ..._checks import InputError, check_type, check_whole, shown
from ..._runtime.buckets import bucket_size
from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory
from ..._runtime.tables import reserve
from ..._types import OCCUPIED
from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.block_builder import BlockBuilder
from ..blocks.words import BLOCK
from ..evidence.lookup import entries
from .block_parts import Part, cut_parts, pool_of, table_of
from .sharded import fetched
from .sharded_checks import check_mesh


class ShardedBlocks(eqx.Module):
    """A `BlockArray` in parts, one a device; arrays are cut along their first axis, and all parts are padded alike.

    Attributes:
        pool: (parts * rows, 8, 8, 8): blocks of a part; row 0 of each is all zeros.
        table: int32 (parts * entries,): row in the part's pool of the blocks that follow the first one in C order over
            the box; 0 for those that the part does not hold.
        span: int32 (parts, 3): number of the block with which the table begins, of the first block that the part
            owns, and one past the last. Blocks of other parts in the table are those that touch listed ones.
        places: int32 (parts * listed, 3): places over the box, in blocks, of the own blocks that kernels are run on,
            in C order; -2 in padding.
        shape: Number of voxels along x, y, z.
        value: What is listed: blocks that hold this value.
        mesh: Devices, in the order of the parts.
    """

    pool: Shaped[jax.Array, "rows 8 8 8"]
    table: Int32[jax.Array, "entries"]
    span: Int32[jax.Array, "parts 3"]
    places: Int32[jax.Array, "listed 3"]
    shape: tuple[int, int, int] = eqx.field(static=True)
    value: int = eqx.field(static=True)
    mesh: Mesh = eqx.field(static=True)

    @property
    def spec(self) -> PartitionSpec:
        """How arrays are cut whose first axis is that of the parts."""
        return PartitionSpec(self.mesh.axis_names)

    @property
    def lattice(self) -> tuple[int, int, int]:
        """Number of blocks of the box along x, y, z."""
        x, y, z = (-(-n // BLOCK) for n in self.shape)
        return x, y, z

    def numbers_at(self, places: Int32[jax.Array, "*n 3"]) -> Int32[jax.Array, "*n"]:
        """Numbers of blocks in C order over the box, -1 beyond it."""
        a, b, c = self.lattice
        i, j, k = (places[..., axis] for axis in range(3))
        is_inside = (i >= 0) & (i < a) & (j >= 0) & (j < b) & (k >= 0) & (k < c)
        return jnp.where(is_inside, (i * b + j) * c + k, -1)

    def rows_of(
        self, numbers: Int32[jax.Array, "*n"], is_wanted: Bool[jax.Array, "*n"]
    ) -> Int32[jax.Array, "*n"]:
        """Within one part: rows of its pool for blocks by their numbers; that of zeros where they are not wanted."""
        entry = numbers - self.span[0, 0]
        # What the table does not reach is not in the part.
        is_there = is_wanted & (entry >= 0) & (entry < self.table.shape[0])
        return jnp.where(is_there, entries(self.table, jnp.where(is_there, entry, 0)), 0)


@refused_after_fork
def shard_blocks(array: BlockArray, mesh: Mesh, *, value: int = int(OCCUPIED)) -> ShardedBlocks:
    """Cut a map in blocks and lay its parts on the devices of a mesh; each process builds those of its own devices.

    Args:
        array: Whole numbers or truth values of the voxels, such as `VoxelGrid.state_blocks()`; the same ones in all
            processes.
        mesh: Devices, under one axis or several, with any names; `jax.make_mesh((8,), ("part",))`.
        value: Parts hold equally many blocks with some voxel of this value, which kernels are run on.

    Raises:
        InputError: If the array is no `BlockArray`, or holds other numbers or no voxel, the mesh is none or empty, the
            value is 0 or no number that the array can hold, or there is not enough memory for the parts of this
            process.
    """
    check_type("array", array, BlockArray, "take grid.state_blocks() of a VoxelGrid")
    check_mesh(mesh)
    if array.dtype.kind not in "bui" or array.num_voxels == 0:
        raise InputError(
            "array must have voxels of whole numbers or truth values, got "
            f"{array.dtype} of shape {array.shape}; shard the states of a map."
        )
    value = _listed_value(value, array.dtype)
    # Each process builds its own parts, but all have to know how long the longest one is.
    parts = list(cut_parts(array, mesh.devices.size, value))
    lengths = _lengths_for(parts)
    own = [
        (part, device)
        for part, device in zip(parts, mesh.devices.flat, strict=True)
        if device.process_index == jax.process_index()
    ]
    # Host devices keep their parts where they were built; others get them one by one.
    held = len(own) if mesh.devices.flat[0].platform == "cpu" else 1
    check_memory(
        held * lengths.num_bytes(array.dtype.itemsize),
        f"{held} of {len(parts)} parts of a map in blocks",
        "take more devices, or a larger voxel size",
    )
    shards = [jax.device_put(_arrays_of(part, array, lengths), device) for part, device in own]
    sharding = NamedSharding(mesh, PartitionSpec(mesh.axis_names))
    pool, table, span, places = (
        jax.make_array_from_single_device_arrays(
            (len(parts) * len(some[0]), *some[0].shape[1:]), sharding, list(some)
        )
        for some in zip(*shards, strict=True)
    )
    return ShardedBlocks(pool, table, span, places, array.shape, value, mesh)


@refused_after_fork
def gather_blocks(values: Shaped[jax.Array, "listed 8 8 8"], blocks: ShardedBlocks) -> BlockArray:
    """What a kernel gave for the listed blocks as an array over the box, 0 elsewhere, on the host of every process.

    All processes must call it. `gather_blocks(classes, blocks).take(grid.occupied_index())` are the classes of the
    occupied voxels.

    Args:
        values: One value for each voxel of each listed block.
        blocks: What the kernel was run on.

    Raises:
        InputError: If the values are no device array of one block for each listed one, or the blocks no map in parts.
    """
    check_blocks(blocks)
    shape, expected = getattr(values, "shape", None), (len(blocks.places), BLOCK, BLOCK, BLOCK)
    if not isinstance(values, jax.Array) or shape != expected:
        got = shown(values) if shape is None else f"a {type(values).__name__} of shape {shape}"
        raise InputError(
            f"values must be a jax.Array of shape {expected}, got {got}; "
            "give what count_in_shards or classes_in_shards made of the same blocks."
        )
    places, found = fetched(blocks.places), fetched(values)
    is_listed = places[:, 0] >= 0
    builder = BlockBuilder(blocks.shape, found.dtype, capacity=int(is_listed.sum()) + 1)
    # A few at a time: what the builder makes of them stays in the cache.
    step = 1 << 13
    for start in range(0, len(places), step):
        some = slice(start, start + step)
        builder.add(places[some][is_listed[some]], found[some][is_listed[some]])
    return builder.finish()


def check_blocks(blocks: object) -> None:
    """Raise if a kernel cannot take it for a map in parts.

    Raises:
        InputError: If it is something else.
    """
    check_type("blocks", blocks, ShardedBlocks, "make them with voxjax.ops.shard_blocks")


def _listed_value(value: object, dtype: np.dtype) -> int:
    """The value that is listed as a number, if voxels of a kind can hold it and it is not 0."""
    number = int(value) if dtype.kind == "b" and isinstance(value, (bool, np.bool_)) else value
    low, high = (0, 1) if dtype.kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    number = check_whole("value", number, int(low), int(high))
    if number == 0:
        raise InputError(
            "value must not be 0, which is what blocks hold that lie nowhere; take OCCUPIED (2)."
        )
    return number


class _Lengths(NamedTuple):
    """Lengths that all parts are padded to: rows of pools, entries of tables, listed blocks."""

    rows: int
    entries: int
    listed: int

    def num_bytes(self, itemsize: int) -> float:
        """Memory of one part."""
        return float(BLOCK_VOXELS * itemsize * self.rows + 4 * self.entries + 12 * self.listed)


def _lengths_for(parts: list[Part]) -> _Lengths:
    """Lengths from the ladder of sizes, so that another map rarely compiles anything."""
    return _Lengths(
        bucket_size(max(part.num_rows for part in parts)),
        bucket_size(max(part.num_entries for part in parts), 1 << 10),
        bucket_size(max(len(part.listed) for part in parts)),
    )


def _arrays_of(part: Part, array: BlockArray, lengths: _Lengths) -> tuple[np.ndarray, ...]:
    """Pool, table, span and places of one part."""
    # Where nothing is written the memory is not taken; a host device takes the arrays as they are.
    pool = reserve(lengths.rows, BLOCK, BLOCK, BLOCK, dtype=array.dtype)
    table = reserve(lengths.entries, dtype=np.int32)
    pool_of(part, array, pool)
    table_of(part, array, table)
    span = np.asarray([[part.first, part.low, part.high]], np.int32)
    # Two blocks below the box: nothing that a padding row looks at lies in it.
    places = np.full((lengths.listed, 3), -2, np.int32)
    places[: len(part.listed)] = np.stack(np.unravel_index(part.listed, array.table.shape), axis=1)
    return pool, table, span, places
