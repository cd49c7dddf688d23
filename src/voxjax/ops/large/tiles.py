"""Kernels over grids that no device could hold: tile by tile with a halo, from any array that can be sliced.

The grid and the result stay where they are (memory, a memory-mapped file, a Zarr array); a device holds two tiles at a
time. All tiles have one shape, so one kernel is compiled.
"""

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np

from ..._checks import InputError
from ..._runtime.forks import refused_after_fork
from ..._runtime.memory import check_memory

Kernel = Callable[[jax.Array], jax.Array]


@runtime_checkable
class Sliceable(Protocol):
    """What is read: a NumPy array, `np.memmap`, Zarr or HDF5 array."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis; x, y, z and any others."""
        ...

    @property
    def dtype(self) -> Any:
        """A NumPy dtype."""
        ...

    def __getitem__(self, key: tuple[slice, ...], /) -> Any:
        """The part that the slices name."""
        ...


@runtime_checkable
class Writable(Sliceable, Protocol):
    """What is written."""

    def __setitem__(self, key: tuple[slice, ...], value: Any, /) -> None:
        """Write the part that the slices name."""
        ...


class Tile(NamedTuple):
    """Where one tile is read and written.

    Attributes:
        core: Slices of the grid that the tile's result fills.
        read: Slices of the grid that it is computed from: the core and what the grid has of its halo.
        place: Slices of the padded block that hold what was read.
        keep: Slices of the kernel's result that hold the core.
    """

    core: tuple[slice, ...]
    read: tuple[slice, ...]
    place: tuple[slice, ...]
    keep: tuple[slice, ...]


@refused_after_fork
def map_tiles(
    kernel: Kernel, source: Sliceable, target: Writable, *, halo: int, tile: int | tuple[int, int, int] = 256
) -> None:
    """Run a kernel over a grid that may be larger than memory; the result is that of the whole grid, bit for bit.

    That holds for kernels whose value at a voxel depends on voxels at most `halo` away and that take what lies outside
    the grid as 0, such as `box_count` with a halo of `size // 2`. While a tile is computed, the one before it is
    written and the next one is read.

    Args:
        kernel: From a block (x, y, z, ...) to a block of the same x, y, z, under `jax.jit`. Hand the same function
            object in again and it is not compiled again.
        source: The grid (x, y, z, ...): NumPy, `np.memmap`, Zarr, HDF5; anything that slices.
        target: Where the result goes: its shape and dtype, other memory than the source. Chunks of files are best a
            divisor of the tile.
        halo: How far the kernel looks [voxel], 0 or more.
        tile: Edge of a tile without its halo [voxel], or its three edges; cut down to the grid's. A tile of edge t
            costs (1 + 2 halo / t)**3 times the work: 7 % for 256 and a halo of 3.

    Raises:
        InputError: If halo or tile are out of range, the target is not what the kernel makes or is the source, or the
            source's dtype is one that JAX would narrow.
    """
    edges = _check_edges(tile, source.shape)
    if halo < 0:
        raise InputError(f"halo must be 0 voxels or more, got {halo}.")
    if target is source or (
        isinstance(source, np.ndarray)
        and isinstance(target, np.ndarray)
        and np.may_share_memory(source, target)
    ):
        raise InputError(
            "target must be other memory than source: a tile's halo is read after its neighbour is written."
        )
    block_shape = (*(edge + 2 * halo for edge in edges), *source.shape[3:])
    need = 3.0 * math.prod(block_shape) * source.dtype.itemsize
    # Two blocks are alive at a time, and what the kernel makes of one.
    check_memory(
        need, f"two tiles of {' x '.join(map(str, block_shape))} voxels", "take a smaller tile or halo"
    )
    run = jax.jit(kernel)
    # Before the first tile: otherwise a result that does not fit would be found with part of it written.
    _check_target(run, block_shape, source, target)
    pending: tuple[Tile, jax.Array] | None = None
    for where in tiles_of(source.shape, edges, halo):
        # A new block for each tile: the device may still be reading the one before.
        block = np.zeros(block_shape, source.dtype)
        block[where.place] = source[where.read]
        # JAX returns before the device has finished: meanwhile the tile before is written and the next one is read.
        result = run(block)
        if pending is not None:
            _write(target, *pending)
        pending = (where, result)
    if pending is not None:
        _write(target, *pending)


def tiles_of(shape: tuple[int, ...], edges: tuple[int, int, int], halo: int) -> Iterator[Tile]:
    """Tiles of a grid in C order; together their cores are the grid, once.

    Args:
        shape: Shape of the grid; axes after the third are not cut.
        edges: Edges of a tile without its halo [voxel].
        halo: Voxels that a tile reads beyond its core, where the grid has them.
    """
    starts = (range(0, side, edge) for side, edge in zip(shape[:3], edges, strict=True))
    for low in product(*starts):
        core, read, place, keep = [], [], [], []
        for first, side, edge in zip(low, shape[:3], edges, strict=True):
            last = min(first + edge, side)
            begin, end = max(first - halo, 0), min(first + edge + halo, side)
            # At the border of the grid less is read than a block holds; the rest stays 0, as outside of any grid.
            core.append(slice(first, last))
            read.append(slice(begin, end))
            place.append(slice(begin - first + halo, end - first + halo))
            keep.append(slice(halo, halo + last - first))
        yield Tile(tuple(core), tuple(read), tuple(place), tuple(keep))


def _write(target: Writable, where: Tile, result: jax.Array) -> None:
    """Copy a tile's core to where it belongs; waits for the device."""
    target[where.core] = np.asarray(result)[where.keep]


def _check_edges(tile: int | tuple[int, int, int], shape: tuple[int, ...]) -> tuple[int, int, int]:
    """The three edges of a tile, none longer than the grid."""
    if len(shape) < 3:
        raise InputError(f"source must have the axes x, y, z, got shape {tuple(shape)}.")
    edges = (tile, tile, tile) if isinstance(tile, int) else tuple(tile)
    if len(edges) != 3 or min(edges) < 1:
        raise InputError(f"tile must be one or three numbers of voxels, 1 or more, got {tile!r}.")
    # An axis without voxels has no tiles, but they have an edge all the same: `range` refuses steps of 0.
    x, y, z = (max(min(edge, side), 1) for edge, side in zip(edges, shape[:3], strict=True))
    return x, y, z


def _check_target(run: Any, block_shape: tuple[int, ...], source: Sliceable, target: Writable) -> None:
    """Raise before the first tile if the result will not fit; nothing is cast on the way."""
    dtype = np.dtype(source.dtype)
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        held = jax.dtypes.canonicalize_dtype(dtype)
        raise InputError(f"source has dtype {dtype}, which JAX would narrow to {held}; convert it first.")
    # What the kernel makes is asked of its shapes alone, without a block.
    made = run.eval_shape(jax.ShapeDtypeStruct(block_shape, dtype))
    if made.shape[:3] != block_shape[:3]:
        raise InputError(
            f"kernel must keep the shape of its block {block_shape[:3]}, it makes {made.shape[:3]}."
        )
    expected = (*source.shape[:3], *made.shape[3:])
    if tuple(target.shape) != expected or np.dtype(target.dtype) != made.dtype:
        raise InputError(
            f"target must be {made.dtype} of shape {expected}, got {target.dtype} of shape {tuple(target.shape)}."
        )
