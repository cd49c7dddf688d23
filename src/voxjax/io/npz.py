"""The `.npz` form of a map: one compressed file of states, origin, voxel size and any log-odds."""

import io
import math
import struct
import zipfile
import zlib

import numpy as np

from .._checks import InputError
from ..grid import VoxelGrid
from .octomap import MAX_VOXELS

VERSION = 1
_DTYPES = {
    "voxjax_map": np.dtype("<i4"),
    "states": np.dtype("u1"),
    "origin": np.dtype("<f4"),
    "voxel_size": np.dtype("<f8"),
    "log_odds": np.dtype("<f4"),
}
# All that zipfile, zlib and numpy were seen to raise on damaged bytes.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, ValueError, OverflowError, OSError,
    RuntimeError, SyntaxError, TypeError,
)  # fmt: skip


def encode_npz(grid: VoxelGrid) -> bytes:
    """Bytes of the `.npz` file of a grid; equal grids give equal bytes."""
    arrays = {
        "voxjax_map": np.int32(VERSION),
        "states": np.asarray(grid.states),
        "origin": np.asarray(grid.origin),
        "voxel_size": np.float64(grid.voxel_size),
    }
    if grid.log_odds is not None:
        arrays["log_odds"] = np.asarray(grid.log_odds)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name, array in arrays.items():
            # ZipInfo's fixed date keeps the bytes independent of the clock.
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(
                    file, np.asarray(array, _DTYPES[name], order="C"), allow_pickle=False
                )
    return buffer.getvalue()


def decode_npz(data: bytes, *, max_voxels: int = MAX_VOXELS) -> VoxelGrid:
    """Read the bytes of a `.npz` file written by `encode_npz`.

    Raises:
        InputError: If the file is damaged, no voxjax map, of a newer version, has wrong shapes, types or
            values, or more than `max_voxels` voxels.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = {name.removesuffix(".npy") for name in archive.namelist()}
            for name in ("voxjax_map", "states", "origin", "voxel_size"):
                if name not in names:
                    raise InputError(f"the archive has no array {name!r}, so it is no voxjax map")
            version = int(_read_array(archive, "voxjax_map", 0, 1))
            if version != VERSION:
                raise InputError(f"the map has version {version}, and this voxjax reads version {VERSION}")
            states = _read_array(archive, "states", 3, max_voxels)
            origin = _read_array(archive, "origin", 1, 3)
            voxel_size = float(_read_array(archive, "voxel_size", 0, 1))
            log_odds = _read_array(archive, "log_odds", 3, max_voxels) if "log_odds" in names else None
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"the archive is damaged ({_first_line(error)})") from error
    if states.size and states.max() > 2:
        raise InputError(f"states must be 0 unknown, 1 free or 2 occupied, got {states.max()}")
    if not np.isfinite(origin).all():
        raise InputError(f"origin must be finite, got {origin.tolist()}")
    if log_odds is not None and not np.isfinite(log_odds).all():
        raise InputError("log_odds must be finite, but some are NaN or infinite")
    return VoxelGrid(states, origin, voxel_size, log_odds)


def _read_array(archive: zipfile.ZipFile, name: str, num_axes: int, most: int) -> np.ndarray:
    """One array; its header is checked before any memory is taken for what it promises."""
    with archive.open(f"{name}.npy") as file:
        try:
            version = np.lib.format.read_magic(file)
            read_header = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, is_fortran, dtype = read_header(file)
        except (ValueError, SyntaxError, TypeError) as error:
            raise InputError(f"the array {name!r} has no valid header ({_first_line(error)})") from error
        if dtype != _DTYPES[name] or len(shape) != num_axes:
            raise InputError(
                f"the array {name!r} must have type {_DTYPES[name]} and {num_axes} axes, "
                f"got type {dtype} and shape {shape}"
            )
        size = math.prod(shape)
        if size > most:
            raise InputError(f"the array {name!r} has {size:,} values, more than the limit of {most:,}")
        # Read in pieces: a short member must not make room for what its header promises.
        pieces, missing = [], size * dtype.itemsize
        while missing and (piece := file.read(min(missing, 1 << 24))):
            pieces.append(piece)
            missing -= len(piece)
        if missing or file.read(1):
            raise InputError(f"the array {name!r} is not as long as its shape says")
    values = np.frombuffer(b"".join(pieces), dtype)
    return values.reshape(shape, order="F" if is_fortran else "C").copy(order="C")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].removesuffix(".")
