"""Maps as files of any format: reading, writing, and the bytes of a file, chosen by the file's ending."""

import os
from pathlib import Path

import numpy as np

from .._checks import InputError, check_count, shown
from .._runtime.whole_files import write_file
from ..grid import VoxelGrid, check_grid
from ..ops.resampling.lattice import check_places
from ..ops.resampling.raycast import grid_from_points
from .budget import Budget
from .files import read_bytes
from .npz import decode_npz, encode_npz
from .octomap import decode_bt, decode_ot, encode_bt, encode_ot
from .ply import decode_ply, encode_ply

# Clouds are no maps before they get a voxel size, so that `read_map` decodes them by itself.
_DECODERS = {".bt": decode_bt, ".ot": decode_ot, ".npz": decode_npz}
_ENCODERS = {".bt": encode_bt, ".ot": encode_ot, ".npz": encode_npz, ".ply": encode_ply}
ENDINGS = tuple(_ENCODERS)
"""File endings that can be read and written."""


def read_map(
    path: str | os.PathLike,
    *,
    voxel_size: float | None = None,
    sensor_origins: object = None,
    max_range: float | None = None,
    max_voxels: int | None = None,
) -> VoxelGrid:
    """Read a map.

    Args:
        path: File ending in .bt, .ot, .npz or .ply.
        voxel_size: Edge length of a voxel [m]. A cloud needs it; another map is brought to it.
        sensor_origins: For clouds: (3,) or (n, 3) [m], where the points were seen from; gives free space.
        max_range: For clouds: longest ray [m].
        max_voxels: Largest dense grid to make from a file; None for what a file of its size can need, up to 2**30.
            In either case no more than fits the memory, which the environment variable `VOXJAX_MEMORY` overrides [GB].

    Returns:
        The map; `.ot` keeps log-odds. From `.bt` and `.ot`: the bounding box of what is known.

    Raises:
        InputError: If the file cannot be read or used; the message names it.
    """
    path = _as_path(path)
    ending = _ending(path)
    if max_voxels is not None:
        max_voxels = check_count("max_voxels", max_voxels, 1)
    try:
        if ending == ".ply":
            if voxel_size is None:
                raise InputError("a cloud needs a voxel size; give voxel_size= (--voxel-size) in metres")
            return _grid_from_cloud(
                read_bytes(path),
                voxel_size=voxel_size,
                sensor_origins=sensor_origins,
                max_range=max_range,
                max_voxels=max_voxels,
            )
        if sensor_origins is not None or max_range is not None:
            raise InputError(
                f"sensor_origins and max_range belong to clouds (.ply), not to {ending} maps; leave them out"
            )
        grid = _DECODERS[ending](read_bytes(path), max_voxels=max_voxels)
        # A file may put its map so far out that float32 cannot tell one voxel from the next.
        check_places(np.stack(grid.extent), grid.voxel_size)
        return grid if voxel_size is None else grid.with_voxel_size(voxel_size)
    except InputError as error:
        raise InputError(f"{path} cannot be read: {str(error).removesuffix('.')}.") from error
    except MemoryError as error:  # a limit that the system does not tell: of a shell, of a batch job
        raise InputError(f"{path} cannot be read: this process may not take the memory for it.") from error


def write_map(path: str | os.PathLike, grid: VoxelGrid, *, force: bool = True) -> None:
    """Write a map, whole or not at all.

    Args:
        path: File ending in .bt (states), .ot (log-odds), .npz (all) or .ply (occupied centres).
        grid: The map.
        force: Whether an existing file is replaced; with False it is an error.

    Raises:
        InputError: If the format cannot hold the grid or the file cannot be written; the message names it.
    """
    write_file(path, encode_map(path, grid), force=force)


def encode_map(path: str | os.PathLike, grid: VoxelGrid) -> bytes:
    """The bytes of the file that `write_map` would write, for those who write several files at once.

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
            "use .bt or .ot (OctoMap), .npz (voxjax) or .ply (points)."
        )
    return ending


def _grid_from_cloud(
    data: bytes, *, voxel_size: float, sensor_origins: object, max_range: float | None, max_voxels: int | None
) -> VoxelGrid:
    budget = Budget(len(data), max_voxels)
    points = decode_ply(data)
    if not len(points):
        raise InputError("the cloud has no points")
    # The most that was seen is 117 bytes for a point. Where rays may cross, the marks of a voxel take four bytes more.
    budget.check(150 * len(points), "the cloud")
    bytes_per_voxel = 1 if sensor_origins is None else 5
    states, origin = grid_from_points(
        points,
        voxel_size=voxel_size,
        sensor_origins=sensor_origins,
        max_range=max_range,
        max_voxels=int(min(budget.most_voxels, budget.memory()[0] / bytes_per_voxel)),
    )
    return VoxelGrid(states, origin, voxel_size)
