"""Maps as files of any format: reading, writing, and the bytes of a file, chosen by the file's ending."""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from .._checks import InputError, check_count, shown
from .._runtime.whole_files import Content, write_files
from ..grid import VoxelGrid, check_grid
from ..maps.findings import Remark
from .crop import EmptyCrop, check_crop
from .decoding import TREE_ENDINGS, ReadOptions, decode_map, decode_store, describe_tree, with_box_remarks
from .files import read_bytes
from .kept_memory import KeptMemory, memory_of_grid
from .map_facts import MapFacts, facts_of_grid
from .npz import encode_npz
from .octomap import check_reach, encode_bt, encode_ot
from .placement import check_placement
from .ply import encode_ply
from .zarr_chunks import StoreError
from .zarr_writing import encode_zarr

_ENCODERS = {".bt": encode_bt, ".ot": encode_ot, ".npz": encode_npz, ".zarr": encode_zarr, ".ply": encode_ply}
ENDINGS = tuple(_ENCODERS)
"""File endings that can be read and written."""


class MapWarning(UserWarning):
    """Points of a file that are no places were left out of its map."""


class LoadedMap(NamedTuple):
    """A map, and what a person should know about it.

    Attributes:
        grid: The map.
        remarks: What was left out, chosen or seen, one sentence each; empty for a map with nothing odd about it.
    """

    grid: VoxelGrid
    remarks: tuple[Remark, ...]


class DescribedMap(NamedTuple):
    """A map in figures, and what a person should know about it.

    Attributes:
        facts: What the map holds.
        remarks: As in `LoadedMap`.
        kept: How the map is kept when it is read, and what memory that takes.
    """

    facts: MapFacts
    remarks: tuple[Remark, ...]
    kept: KeptMemory


def read_map(
    path: str | os.PathLike,
    *,
    voxel_size: float | None = None,
    crop: object = None,
    drop_isolated: bool = False,
    strict: bool = False,
    sensor_origins: object = None,
    max_range: float | None = None,
    max_voxels: int | None = None,
    scale: float = 1.0,
    shift: object = (0.0, 0.0, 0.0),
) -> VoxelGrid:
    """Read a map.

    Nothing is changed unasked, but for points of clouds that are NaN or infinite: they are left out, and a `MapWarning`
    says how many they are.

    Args:
        path: File ending in .bt, .ot, .npz or .ply, or folder ending in .zarr.
        voxel_size: Edge length of a voxel [m]; a map is brought to it. None keeps that of a map, and estimates that of
            a cloud from the spacing of its points, rounded to 1, 2 or 5 by a power of ten.
        crop: Low and high corner of a box (2, 3) [m]: only what lies in it is kept, voxels by their centres, of clouds
            without sensor origins the points themselves.
        drop_isolated: Whether pieces are left out that lie farther from the rest than the rest is wide, at most 2 % of
            what is occupied, and the free space on the way to them.
        strict: Whether a cloud with NaN, infinite or duplicate points is an error.
        sensor_origins: For clouds: (3,) or (n, 3) [m], where the points were seen from; gives free space. One row for
            each point of the file, those that are left out too.
        max_range: For clouds: longest ray [m].
        max_voxels: Largest box of voxels to make from a file; None for any box whose known voxels fit the memory that a
            file of its size can need. In either case no more than fits the memory, which the environment variable
            `VOXJAX_MEMORY` overrides [GB].
        scale: All positions and lengths of the file are multiplied by it, those of sensors too: 0.001 for a map in
            millimetres. `crop` is in the frame of the file.
        shift: The map is moved by that afterwards (3,) [m]; both are exact to float64, and nothing is resampled but to
            a `voxel_size` that was asked for, which is that of the result.

    Returns:
        The map; `.ot` keeps log-odds. From `.bt` and `.ot`: the bounding box of what is known. From `.zarr`: a map that
        reads chunks when they are needed; what is wrong with one of them is an `InputError` then.

    Raises:
        InputError: If the file cannot be read or used; the message names it. Among others, a cloud whose spacing was
            lost because its coordinates, far from zero, are of single precision.
    """
    options = ReadOptions(
        voxel_size=voxel_size,
        crop=crop,
        drop_isolated=drop_isolated,
        strict=strict,
        sensor_origins=sensor_origins,
        max_range=max_range,
        max_voxels=max_voxels,
        placement=check_placement(scale, shift),
    )
    path = _as_path(path)
    grid, remarks = _load(path, options)
    for remark in remarks:
        if remark.code == "not_finite":
            warnings.warn(f"{path}: {remark.text}.", MapWarning, stacklevel=2)
    return grid


def load_map(
    path: str | os.PathLike,
    *,
    voxel_size: float | None = None,
    crop: object = None,
    drop_isolated: bool = False,
    strict: bool = False,
    sensor_origins: object = None,
    max_range: float | None = None,
    max_voxels: int | None = None,
    scale: float = 1.0,
    shift: object = (0.0, 0.0, 0.0),
) -> LoadedMap:
    """Read a map as `read_map` does, and look for what a person should know about it.

    Args:
        path: As in `read_map`, and so are all others.
        voxel_size: Edge length of a voxel [m].
        crop: Box to cut to [m].
        drop_isolated: Whether isolated far pieces are left out.
        strict: Whether a cloud with NaN, infinite or duplicate points is an error.
        sensor_origins: For clouds: where the points were seen from [m].
        max_range: For clouds: longest ray [m].
        max_voxels: Largest box of voxels to make from a file.
        scale: Factor of all positions and lengths.
        shift: What the map is moved by afterwards [m].

    Returns:
        The map and the remarks; what is left out is among these, and no warning is given.

    Raises:
        InputError: As in `read_map`.
    """
    options = ReadOptions(
        voxel_size=voxel_size,
        crop=crop,
        drop_isolated=drop_isolated,
        strict=strict,
        sensor_origins=sensor_origins,
        max_range=max_range,
        max_voxels=max_voxels,
        placement=check_placement(scale, shift),
        looks=True,
    )
    grid, remarks = _load(_as_path(path), options)
    return LoadedMap(grid, with_box_remarks(remarks, facts_of_grid(grid)))


def describe_map(
    path: str | os.PathLike,
    *,
    voxel_size: float | None = None,
    crop: object = None,
    drop_isolated: bool = False,
    strict: bool = False,
) -> DescribedMap:
    """What `load_map` would give, in figures; of an octree at its own voxel size no dense grid is made for that.

    Args:
        path: As in `read_map`, and so are all others.
        voxel_size: Edge length of a voxel [m].
        crop: Box to cut to [m].
        drop_isolated: Whether isolated far pieces are left out.
        strict: Whether a cloud with NaN, infinite or duplicate points is an error.

    Raises:
        InputError: As in `read_map`.
    """
    path = _as_path(path)
    ending = _ending(path)
    options = ReadOptions(voxel_size, crop, drop_isolated, strict, looks=True)
    if ending not in TREE_ENDINGS or voxel_size is not None:
        grid, remarks = _load(path, options)
        facts, memory = facts_of_grid(grid), memory_of_grid(grid)
    else:
        with _naming(path):
            facts, remarks, memory = describe_tree(read_bytes(path), ending, options)
    return DescribedMap(facts, with_box_remarks(remarks, facts), memory)


def _load(path: Path, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """The map in a file, and what was done to it or, if the options look for it, seen."""
    ending = _ending(path)
    if options.max_voxels is not None:
        options = options._replace(max_voxels=check_count("max_voxels", options.max_voxels, 1))
    if options.crop is not None:
        check_crop(options.crop)
    with _naming(path):
        if ending == ".zarr":
            return decode_store(path, options)
        return decode_map(read_bytes(path), ending, options)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Let errors within the block name the file that cannot be read."""
    try:
        yield
    except StoreError:  # which names it
        raise
    except InputError as error:
        kind = EmptyCrop if isinstance(error, EmptyCrop) else InputError
        raise kind(f"{path} cannot be read: {str(error).removesuffix('.')}.") from error
    except MemoryError as error:  # a limit that the system does not tell: of a shell, of a batch job
        raise InputError(f"{path} cannot be read: this process may not take the memory for it.") from error


def write_map(path: str | os.PathLike, grid: VoxelGrid, *, force: bool = True) -> None:
    """Write a map, whole or not at all.

    Args:
        path: File ending in .bt (states), .ot (log-odds), .npz (all) or .ply (occupied centres), or folder ending in
            .zarr (all; written chunk by chunk).
        grid: The map.
        force: Whether an existing file is replaced; with False it is an error.

    Raises:
        InputError: If the format cannot hold the grid or the file cannot be written; the message names it.
    """
    write_files({_as_path(path): encode_map(path, grid)}, force=force)


def encode_map(path: str | os.PathLike, grid: VoxelGrid) -> Content:
    """The bytes of the file that `write_map` would write, or its folder, for those who write several files at once.

    Raises:
        InputError: If the format cannot hold the grid; the message names the path.
    """
    path = _as_path(path)
    check_grid("grid", grid)
    encode = _ENCODERS[_ending(path)]
    try:
        return encode(grid)
    except InputError as error:
        raise InputError(f"{path} cannot be written: {str(error).removesuffix('.')}.") from error


def check_place(path: str | os.PathLike, grid: VoxelGrid) -> None:
    """Refuse a file whose format does not reach where a grid lies, before work is done for it.

    Args:
        path: The file, which need not exist.
        grid: A map in the frame of the one that will be written.

    Raises:
        InputError: If the format does not reach there; the message names the path.
    """
    path = _as_path(path)
    if _ending(path) in TREE_ENDINGS:
        try:
            check_reach(grid)
        except InputError as error:
            raise InputError(f"{path} cannot be written: {str(error).removesuffix('.')}.") from error


def _as_path(path: object) -> Path:
    """The name of a map's file; bytes, which name files too, have no ending that says what the file holds."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"path must be the name of a file, got {shown(path)}.")
    return Path(path)


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    # A folder whose name ends like a map's is told by whatever opens or replaces it.
    if ending not in _ENCODERS and path.is_dir():
        raise InputError(f"{path} is a folder; give the name of a file.")
    if ending not in _ENCODERS:
        raise InputError(
            f"{path}: the ending {ending!r} is not known; "
            "use .bt or .ot (OctoMap), .npz (voxjax), .zarr (a Zarr store) or .ply (points)."
        )
    return ending
