"""Maps in Zarr stores (version 3), opened lazily: attributes and the list of chunks are read, chunks when asked for.

A store is a group with the array `states`, uint8 (x, y, z), and perhaps `log_odds`, float32, of the same shape; chunks
that are not there hold 0. Its attributes say where the voxels lie. `zarr_chunks` reads the chunks.
"""

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import InputError, shown
from .._runtime.memory import check_memory
from ..grid import VoxelGrid
from ..ops.blocks.block_array import Shape, lattice_shape
from ..ops.blocks.chunked_array import ChunkedArray
from .budget import Budget
from .files import read_bytes
from .zarr_chunks import MARKER, ChunksOfZarr, PlainChunks, StoreChunks
from .zarr_listing import known_files
from .zarr_shards import layout_of

VERSION = 1


def check_zarr_support() -> None:
    """Raise if the library behind stores is not installed.

    Raises:
        InputError: If it is not installed; the message says what to install.
    """
    if find_spec("zarr") is None:
        raise InputError(
            "maps in .zarr need the package zarr, which is not installed; run: pip install 'voxjax[zarr]'."
        )


def open_zarr(path: Path, *, max_voxels: int | None = None) -> VoxelGrid:
    """The map in a store, of which no chunk is read yet.

    Args:
        path: The folder of the store.
        max_voxels: Largest box; None for no limit, for nothing of its size is made.

    Raises:
        InputError: If it is no store, or none of a map; the message is for a sentence that names it. What is wrong
            with a chunk is a `StoreError` when that is read.
    """
    check_zarr_support()
    _check_folder(path)
    given, path = path, path.absolute()  # the working directory may be another one when a chunk is read
    import zarr.storage

    with _damage_explained(MARKER):
        store = zarr.storage.LocalStore(path, read_only=True)
        group = zarr.open_group(store, mode="r", zarr_format=3, use_consolidated=False)
        attributes = group.attrs.asdict()
    origin, voxel_size = _place_of(attributes)
    states = _opened(path, given, group, "states")
    if states is None:
        raise InputError("the store has no array 'states', so it is no voxjax map")
    if max_voxels is not None:
        Budget(0, max_voxels).check_grid(states.shape, 0)
    log_odds = _opened(path, given, group, "log_odds")
    if log_odds is not None and log_odds.shape != states.shape:
        raise InputError(
            f"the array 'log_odds' must have the shape of 'states' {states.shape}, got {log_odds.shape}"
        )
    return VoxelGrid(states, origin, voxel_size, log_odds)


def _check_folder(path: Path) -> None:
    """Refuse what is no folder of a Zarr group, before zarr is asked, whose words are about its own functions."""
    try:
        names = os.listdir(path)
    except NotADirectoryError as error:
        raise InputError("it is a file, and a Zarr store is a folder; unpack it first") from error
    except (OSError, ValueError) as error:  # no such folder, a name with a zero in it
        raise InputError(f"{getattr(error, 'strerror', None) or error}") from error
    if MARKER in names:
        read_bytes(path / MARKER, most=1 << 20)  # a pipe, which would be waited for, is refused here
        return
    if {".zgroup", ".zarray", ".zattrs"} & set(names):
        raise InputError("it is a Zarr store of version 2; write it again in version 3")
    raise InputError(f"the folder has no file {MARKER}, so it is no Zarr store of version 3")


def _place_of(attributes: dict) -> tuple[list[float], float]:
    """Origin and voxel size [m] from the attributes of a map."""
    for name in ("voxjax_map", "origin", "voxel_size"):
        if name not in attributes:
            raise InputError(f"the store has no attribute {name!r}, so it is no voxjax map")
    version, origin, voxel_size = (attributes[name] for name in ("voxjax_map", "origin", "voxel_size"))
    if version != VERSION:
        raise InputError(f"the map has version {shown(version)}, and this voxjax reads version {VERSION}")
    if attributes.get("units", "m") != "m":
        raise InputError(f"the attribute 'units' must be 'm', got {shown(attributes['units'])}")
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_is_finite, origin)):
        raise InputError(f"the attribute 'origin' must be three finite numbers [m], got {shown(origin)}")
    if not _is_finite(voxel_size):
        raise InputError(f"the attribute 'voxel_size' must be a finite number [m], got {shown(voxel_size)}")
    return [float(x) for x in origin], float(voxel_size)


def _is_finite(value: object) -> bool:
    """Whether a value from JSON is a number that float64 holds; whole ones may have any number of digits there."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max  # pyright: ignore[reportArgumentType]


def _opened(path: Path, given: Path, group: Any, name: str) -> ChunkedArray | None:
    """An array of a store, whose chunks are read as they are asked for; None if there is none.

    Args:
        path: The folder of the store, absolute.
        given: Its name for messages.
        group: What zarr knows of it.
        name: Of the array.

    Raises:
        InputError: If it is not as a map has it.
    """
    if not os.path.lexists(path / name):
        return None
    try:
        read_bytes(path / name / MARKER, most=1 << 20)
    except InputError as error:
        raise InputError(f"{name}/{MARKER}: {error}") from error
    with _damage_explained(f"{name}/{MARKER}"):
        array = group[name]
        axes, shape = array.metadata.dimension_names, array.shape
        # A shard is a file of several chunks, each of which is read on its own.
        chunk, file = array.chunks, array.shards or array.chunks
        dtype, fill_value = array.dtype, array.fill_value
        metadata = array.metadata.to_dict()
    expected = np.dtype(np.uint8 if name == "states" else np.float32)
    if dtype != expected or len(shape) != 3:
        raise InputError(
            f"the array {name!r} must have type {expected} and 3 axes, got {dtype} and shape {shape[:4]}"
        )
    # An axis may have no name.
    if axes is not None and any(axis not in (None, own) for axis, own in zip(axes, "xyz", strict=True)):
        raise InputError(f"the array {name!r} must have the axes x, y, z, got {', '.join(map(str, axes))}")
    if fill_value != 0:
        raise InputError(f"the array {name!r} must have the fill value 0, got {fill_value}")
    if min(*chunk, *file) < 1:  # which zarr takes
        raise InputError(f"{name}/{MARKER} is damaged: its chunks have no voxels")
    _check_size(name, shape, chunk, expected.itemsize)
    known = known_files(path / name, _lattice(shape, file), array.metadata.encode_chunk_key)
    layout = layout_of(path / name, metadata)
    source = ChunksOfZarr(path / name, array) if layout is None else PlainChunks(layout, known)
    for axis in range(3):
        known = np.repeat(known, file[axis] // chunk[axis], axis=axis)
    if isinstance(source, PlainChunks):
        source.leave_out_absent(known)
    known = known[tuple(map(slice, _lattice(shape, chunk)))]
    return ChunkedArray(shape, expected, chunk, known, StoreChunks(path, given, name, shape, chunk, source))


def _check_size(name: str, shape: Shape, chunk: Shape, itemsize: int) -> None:
    """Refuse a box of more blocks than can be counted, and chunks that are too large or too many."""
    size = " x ".join(map(str, shape))
    if math.prod(lattice_shape(shape)) >= 1 << 31 or max(shape) >= 1 << 31:
        raise InputError(
            f"the array {name!r} of {size} voxels has more blocks of 8 x 8 x 8 than 32 bits count"
        )
    if math.prod(_lattice(shape, chunk)) >= 1 << 28:
        sides = " x ".join(map(str, chunk))
        raise InputError(
            f"the array {name!r} of {size} voxels has too many chunks of {sides}; write larger ones"
        )
    # What is decoded is held beside what was read.
    advice = "write the store with smaller chunks"
    check_memory(2.0 * itemsize * math.prod(chunk), f"a chunk of the array {name!r}", advice, on_device=False)


def _lattice(shape: Shape, chunk: Shape) -> Shape:
    """Number of chunks along x, y, z."""
    x, y, z = (-(-n // side) for n, side in zip(shape, chunk, strict=True))
    return x, y, z


@contextmanager
def _damage_explained(name: str) -> Iterator[None]:
    """Whatever goes wrong inside is the fault of a file of metadata: to be used around calls of zarr alone."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:  # zarr promises no set of exceptions
        raise InputError(f"{name} is damaged, or of something else than a map") from error
