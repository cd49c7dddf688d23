"""One grid over many devices: each holds a slab, and hands its border to its neighbours before a kernel runs.

The exchange is written out (`shard_map` and `ppermute`): left to automatic partitioning, window kernels are correct
but several times slower than on one device. It works alike on the devices of one process and of many processes that
`jax.distributed` has joined.
"""

import math
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Shaped

from ..._checks import InputError
from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory
from .sharded_checks import check_mesh
from .tiles import Sliceable


class ShardedGrid(eqx.Module):
    """A grid cut along x, or x and y, or x, y and z, into equal parts, one a device.

    Attributes:
        values: (x, y, z, ...), padded at the high ends to a multiple of the number of parts; the padding is 0.
        shape: Size of the grid without the padding [voxel].
        mesh: Devices: its first axis cuts x, the second y, the third z.
    """

    values: Shaped[jax.Array, "x y z *more"]
    shape: tuple[int, int, int] = eqx.field(static=True)
    mesh: Mesh = eqx.field(static=True)


@refused_after_fork
def shard_grid(grid: Sliceable, mesh: Mesh, *, max_halo: int = 7) -> ShardedGrid:
    """Cut a grid and lay its parts on the devices of a mesh; each process reads only the parts of its own devices.

    Args:
        grid: (x, y, z, ...): NumPy, `np.memmap`, Zarr, HDF5, the same one in all processes.
        mesh: One to three axes with any names, which cut x, y, z in this order; `jax.make_mesh((8,), ("x",))`.
        max_halo: Widest halo that kernels will ask for [voxel]. A part is at least this thick, so that a halo comes
            from the next device; grids that are too thin for their mesh are padded to that.

    Raises:
        InputError: If the grid has fewer than three axes or no voxels, the mesh no devices or more than three axes, or
            the halo is below 0.
    """
    check_mesh(mesh)
    if len(grid.shape) < 3 or 0 in grid.shape:
        raise InputError(f"grid must have voxels along x, y, z, got shape {tuple(grid.shape)}.")
    if not 1 <= len(mesh.axis_names) <= 3:
        raise InputError(f"mesh must have one to three axes, got {len(mesh.axis_names)}.")
    if max_halo < 0:
        raise InputError(f"max_halo must be 0 voxels or more, got {max_halo}.")
    # All parts are equally large, as device meshes need them, and thick enough for a halo to come from one neighbour.
    padded = list(grid.shape)
    for axis, parts in enumerate(mesh.devices.shape):
        padded[axis] = parts * max(-(-padded[axis] // parts), max_halo)
    # Parts are made one by one, each for its own device.
    need = math.prod(padded) * grid.dtype.itemsize / mesh.devices.size
    check_memory(
        need, f"a part of a grid padded to {' x '.join(map(str, padded))}", "take a smaller max_halo"
    )

    def part(index: tuple[slice, ...] | None) -> np.ndarray:
        assert index is not None
        spans = [s.indices(side)[:2] for s, side in zip(index, padded, strict=True)]
        values = np.zeros([high - low for low, high in spans], grid.dtype)
        # A part may lie in the padding, in whole or at its end: only what the grid has of it is read.
        inside = [
            slice(min(low, side), min(high, side))
            for (low, high), side in zip(spans, grid.shape, strict=True)
        ]
        values[tuple(slice(0, s.stop - s.start) for s in inside)] = grid[tuple(inside)]
        return values

    sharding = NamedSharding(mesh, PartitionSpec(*mesh.axis_names))
    values = jax.make_array_from_callback(tuple(padded), sharding, part)
    x, y, z = (int(side) for side in grid.shape[:3])
    return ShardedGrid(values, (x, y, z), mesh)


@refused_after_fork
@partial(jax.jit, static_argnames=("kernel", "halo"))
def map_shards(kernel: Callable[[jax.Array], jax.Array], grid: ShardedGrid, *, halo: int) -> ShardedGrid:
    """Run a kernel on every part of a grid at once; the result is that of the whole grid, bit for bit.

    That holds for kernels whose value at a voxel depends on voxels at most `halo` away and that take what lies outside
    the grid as 0, such as `box_count` with a halo of `size // 2`. Differentiable where the kernel is.

    Args:
        kernel: From a block (x, y, z, ...) to a block of the same x, y, z. Hand the same function object in again and
            it is not compiled again.
        grid: What `shard_grid` gives, or the result of another kernel.
        halo: How far the kernel looks [voxel].

    Returns:
        The result, cut as the grid is; 0 in the padding, so that the next kernel finds nothing outside.

    Raises:
        InputError: If the halo is below 0 or thicker than a part, or the kernel changes the shape.
    """
    if halo < 0:
        raise InputError(f"halo must be 0 voxels or more, got {halo}.")
    names = grid.mesh.axis_names
    # A mesh may have fewer axes than the grid, whose last ones then stay whole: the shapes need not be as long.
    thickness = [n // parts for n, parts in zip(grid.values.shape, grid.mesh.devices.shape, strict=False)]
    if min(thickness) < halo:
        raise InputError(
            f"halo must be at most {min(thickness)} voxels, the thickness of a part, got {halo}; "
            "cut the grid with a larger max_halo."
        )

    def on_part(values: jax.Array) -> jax.Array:
        block = values
        for axis, name in enumerate(names):
            # Corners travel, too: the second axis sends what the first one has brought.
            block = _with_halo(block, axis, name, grid.mesh.shape[name], halo)
        result = kernel(block)
        if result.shape[:3] != block.shape[:3]:
            raise InputError(
                f"kernel must keep the shape of its block {block.shape[:3]}, it makes {result.shape[:3]}."
            )
        # What the kernel made of the halo lacks neighbours of its own; what it made of the padding must be 0 again, for
        # the next kernel to find nothing there.
        for axis, name in enumerate(names):
            result = jax.lax.slice_in_dim(result, halo, halo + values.shape[axis], axis=axis)
            result = _cleared_past(result, axis, name, grid.mesh.shape[name], grid.shape[axis])
        return result

    spec = PartitionSpec(*names)
    # The check of varying axes would refuse kernels with loops that start from constants.
    run = jax.shard_map(on_part, mesh=grid.mesh, in_specs=spec, out_specs=spec, check_vma=False)
    return ShardedGrid(run(grid.values), grid.shape, grid.mesh)


@refused_after_fork
def gather_shards(grid: ShardedGrid) -> np.ndarray:
    """The whole grid without its padding, on the host of every process; all processes must call it."""
    return fetched(grid.values)[tuple(slice(side) for side in grid.shape)]


def fetched(values: Shaped[jax.Array, "*n"]) -> Shaped[np.ndarray, "*n"]:
    """All parts of an array on the host of every process; all processes must call it."""
    if values.is_fully_addressable:
        return np.asarray(values)
    return np.asarray(multihost_utils.process_allgather(values, tiled=True))


def _with_halo(block: jax.Array, axis: int, name: str, parts: int, halo: int) -> jax.Array:
    """The block between the borders of its two neighbours; where there is none, `ppermute` brings zeros."""
    if halo == 0:
        return block
    low = jax.lax.slice_in_dim(block, 0, halo, axis=axis)
    high = jax.lax.slice_in_dim(block, block.shape[axis] - halo, block.shape[axis], axis=axis)
    before = jax.lax.ppermute(high, name, [(i, i + 1) for i in range(parts - 1)])
    after = jax.lax.ppermute(low, name, [(i + 1, i) for i in range(parts - 1)])
    return jnp.concatenate([before, block, after], axis=axis)


def _cleared_past(result: jax.Array, axis: int, name: str, parts: int, side: int) -> jax.Array:
    """The result with 0 in what lies past the end of the grid."""
    length = result.shape[axis]
    # Without padding along this axis there is nothing to clear.
    if parts * length == side:
        return result
    shape = [1] * result.ndim
    shape[axis] = length
    # All parts run one program: each knows only by its number where in the whole grid it lies.
    place = jax.lax.axis_index(name).astype(jnp.int32) * length + jnp.arange(length, dtype=jnp.int32)
    is_inside = jnp.broadcast_to((place < side).reshape(shape), result.shape)
    return jnp.where(is_inside, result, jnp.zeros((), result.dtype))
