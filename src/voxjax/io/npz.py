"""The `.npz` form of a map: one compressed file of states, origin, voxel size and any log-odds."""

import io
import math
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import product
from typing import NamedTuple

import numpy as np

from .._checks import InputError, shown
from .._types import OCCUPIED
from ..grid import VoxelGrid
from ..maps.findings import Remark, rounded_origin_remark
from ..ops.resampling.lattice import MAX_VOXELS
from .budget import Budget
from .text_header import whole_number

VERSION = 2
# All are little endian, so that equal grids give equal bytes on all machines.
_DTYPES = {
    "voxjax_map": np.dtype("<i4"),
    "states": np.dtype("|u1"),
    "origin": np.dtype("<f8"),
    "voxel_size": np.dtype("<f8"),
    "log_odds": np.dtype("<f4"),
}
# Files of version 1 differ in that alone.
_ORIGIN_OF_VERSION_1 = np.dtype("<f4")
_MOST_AT_ONCE = 1 << 20
"""Largest piece of an archive that is taken into memory at once [byte]."""


def encode_npz(grid: VoxelGrid) -> bytes:
    """Bytes of the `.npz` file of a grid; equal grids give equal bytes."""
    if grid.is_sparse and grid.num_voxels > MAX_VOXELS:
        raise InputError(
            f".npz files hold all voxels of a box, at most {MAX_VOXELS:,}, and this one has {grid.num_voxels:,}; "
            "write it as .bt, .ot or .zarr, or crop it"
        )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        _write_array(archive, "voxjax_map", (), [np.int32(VERSION)])
        _write_array(archive, "states", grid.shape, _planes(grid, grid.states_in))
        _write_array(archive, "origin", (3,), [np.asarray(grid.origin)])
        _write_array(archive, "voxel_size", (), [np.float64(grid.voxel_size)])
        if grid.has_log_odds:
            _write_array(archive, "log_odds", grid.shape, _planes(grid, grid.log_odds_in))
    return buffer.getvalue()


def _planes(grid: VoxelGrid, values_in: Callable) -> Iterator[np.ndarray]:
    """Windows of a grid, some planes each, one after the other along x."""
    nx, ny, nz = grid.shape
    step = max((1 << 24) // max(ny * nz, 1), 1)
    for start in range(0, nx, step):
        yield values_in((start, 0, 0), (min(start + step, nx), ny, nz))


def _write_array(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], parts: Iterable[np.ndarray | np.generic]
) -> None:
    """Write one array, whose values come in parts."""
    # ZipInfo's fixed date keeps the bytes independent of the clock.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    kind = _DTYPES[name]
    header = {"descr": kind.str, "fortran_order": False, "shape": shape}
    # An entry's size is not known before it is written, and zipfile must be told that it may pass 2 GiB.
    with archive.open(entry, "w", force_zip64=True) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for part in parts:
            # Values are written in C order, whatever their order in memory, so that equal grids give equal bytes.
            file.write(np.asarray(part, kind).tobytes("C"))


def decode_npz(
    data: bytes, *, max_voxels: int | None = None, note: Callable[[Remark], None] | None = None
) -> VoxelGrid:
    """Read the bytes of a `.npz` file written by `encode_npz`.

    Args:
        data: The whole file.
        max_voxels: Largest grid; None for what a file of this size can hold.
        note: Called with what the file has lost of its map: version 1 keeps the origin in single precision.

    Raises:
        InputError: If the file is damaged, no voxjax map, of a newer version, has wrong shapes, types or
            values, or holds more than the limit.
    """
    budget = Budget(len(data), max_voxels)
    with _damage_explained():
        archive = zipfile.ZipFile(_Pieces(data))
        listed = archive.namelist()
    names = {name.removesuffix(".npy") for name in listed}
    if len(set(listed)) < len(listed):
        raise InputError(
            "the archive has two arrays of the same name, so that it does not say which is meant"
        )
    for name in ("voxjax_map", "states", "origin", "voxel_size"):
        if name not in names:
            raise InputError(f"the archive has no array {name!r}, so it is no voxjax map")
    # The version is read before the other arrays, which may mean other things in a newer one.
    version = int(_read_array(archive, "voxjax_map", (), budget))
    if not 1 <= version <= VERSION:
        raise InputError(f"the map has version {version}, and this voxjax reads versions 1 to {VERSION}")
    states = _read_array(archive, "states", (None, None, None), budget)
    dtype = _ORIGIN_OF_VERSION_1 if version == 1 else _DTYPES["origin"]
    origin = _read_array(archive, "origin", (3,), budget, dtype=dtype)
    voxel_size = float(_read_array(archive, "voxel_size", (), budget))
    log_odds = None
    if "log_odds" in names:
        # The shape is that of the states, so log-odds of another one are refused before memory is taken for them.
        log_odds = _read_array(archive, "log_odds", states.shape, budget, held=states.nbytes)
    # Bytes are never negative, so the largest one tells of all.
    if states.size and states.max() > OCCUPIED:
        raise InputError(f"states must be 0 unknown, 1 free or 2 occupied, got {states.max()}")
    if not np.isfinite(origin).all():
        raise InputError(f"origin must be finite, got {origin.tolist()}")
    if log_odds is not None and not np.isfinite(log_odds).all():
        raise InputError("log_odds must be finite, but some are NaN or infinite")
    grid = VoxelGrid(states, origin, voxel_size, log_odds)
    lost = rounded_origin_remark(origin, voxel_size) if version == 1 else None
    if lost is not None and note is not None:
        note(lost)
    return grid


class _Pieces(io.BytesIO):
    """Bytes of which nobody reads too many at once: `zipfile` makes objects of all of an archive's table."""

    def read(self, size: int | None = -1, /) -> bytes:
        left = len(self.getbuffer()) - self.tell()
        if (left if size is None or size < 0 else min(size, left)) > _MOST_AT_ONCE:
            raise InputError("the archive's table of contents is longer than that of any map")
        return super().read(size)


class _Member:
    """One array's file in an archive."""

    def __init__(self, archive: zipfile.ZipFile, name: str):
        with _damage_explained():
            entry = archive.getinfo(f"{name}.npy")
            # Other methods pack a million bytes into one, and no program writes maps with them.
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError(f"the array {name!r} is compressed in a way that .npz files do not use")
            # The lowest of these bits says that the member is encrypted.
            if entry.flag_bits & 1:
                raise InputError(f"the array {name!r} is encrypted; write the map without a password")
            self._file = archive.open(entry)

    def read(self, size: int) -> bytes:
        """At most `size` bytes more; none at the end."""
        with _damage_explained():
            return self._file.read(size)


class _NpyHeader(NamedTuple):
    """What stands before the values of an array.

    Attributes:
        descr: NumPy's name of the type.
        is_fortran: Whether the first index runs fastest.
        shape: Length of each axis.
    """

    descr: str
    is_fortran: bool
    shape: tuple[int, ...]


def _read_array(
    archive: zipfile.ZipFile,
    name: str,
    expected: tuple[int | None, ...],
    budget: Budget,
    *,
    dtype: np.dtype | None = None,
    held: int = 0,
) -> np.ndarray:
    """One array; its header is checked before any memory is taken for what it promises.

    Args:
        archive: The whole file.
        name: Name of the array.
        expected: Shape of the array in a map, None for an axis of any length.
        budget: Limits of the file.
        dtype: Type of the array; None for that of the newest version.
        held: Memory that other arrays of this file take [byte].

    Raises:
        InputError: If it is missing, damaged or not as expected, or beyond the budget.
    """
    member = _Member(archive, name)
    header = _read_npy_header(member)
    if header is None:
        raise InputError(f"the array {name!r} has no valid header")
    descr, is_fortran, shape = header
    dtype = _DTYPES[name] if dtype is None else dtype
    _check_type(name, dtype, descr, shape, expected)
    # Beside the values there is a copy in the other order of axes, or the truth values of the check of numbers.
    itemsize, is_checked = dtype.itemsize, name == "log_odds"
    budget.check_grid(shape, itemsize * (2 if is_fortran else 1) + is_checked, held)
    values = np.empty(math.prod(shape), dtype)
    if not _fill(values.view(np.uint8), member):
        raise InputError(f"the array {name!r} is not as long as its shape says")
    return _transposed(values.reshape(shape[::-1])) if is_fortran else values.reshape(shape)


def _transposed(values: np.ndarray, *, tile: int = 1 << 14) -> np.ndarray:
    """The array with its axes in reverse order, as a C array.

    In tiles that fit the cache: where the last axis becomes the first, a copy in one piece misses it at every value.
    """
    if values.ndim != 3:
        return np.ascontiguousarray(values.T)
    result = np.empty(values.shape[::-1], values.dtype)
    nx, ny, nz = (max(side, 1) for side in result.shape)
    # Some 64 values along the axes that run fastest in either order, and more where the others are short.
    dz = min(nz, max(64, tile // min(nx * ny, tile)))
    dy = min(ny, max(tile // (min(nx, 64) * dz), 1))
    dx = min(nx, max(tile // (dy * dz), 64))
    for x, y, z in product(range(0, nx, dx), range(0, ny, dy), range(0, nz, dz)):
        result[x : x + dx, y : y + dy, z : z + dz] = values[z : z + dz, y : y + dy, x : x + dx].T
    return result


def _check_type(
    name: str, dtype: np.dtype, descr: str, shape: tuple[int, ...], expected: tuple[int | None, ...]
) -> None:
    """Raise unless an array has the type and the shape that it has in a map."""
    fits = len(shape) == len(expected) and all(b in (None, a) for a, b in zip(shape, expected, strict=True))
    # Bytes have no order, and NumPy marks that with a bar.
    if not fits or descr.replace("|", "<") != dtype.str.replace("|", "<"):
        form = f"{len(expected)} axes" if None in expected else f"shape {expected}"
        raise InputError(
            f"the array {name!r} must have type {dtype} and {form}, got {shown(descr)} and shape {shape[:4]}"
        )


def _read_npy_header(member: _Member, *, most: int = 4096) -> _NpyHeader | None:
    """The header of an array; None if it is none, or longer than those of arrays of numbers are.

    NumPy's own reader takes memory for a header before it looks at its length, and evaluates it as Python.
    """
    lead = member.read(8)
    # Version 1 has two bytes for the length of the header, and those after it have four.
    size = 2 if lead[6:7] == b"\x01" else 4
    length = int.from_bytes(member.read(size), "little")
    if lead[:6] != b"\x93NUMPY" or not 0 < length <= most:
        return None
    # NumPy writes these three keys in this order; a header of another form is that of no map.
    form = (
        r"\s*\{\s*'descr'\s*:\s*'([^']*)'\s*,\s*'fortran_order'\s*:\s*(True|False)\s*,"
        r"\s*'shape'\s*:\s*\(([0-9,\s]*)\)\s*,?\s*\}\s*"
    )
    # Every byte is a letter of latin-1, so that it is the pattern that refuses what is no header.
    match = re.fullmatch(form, member.read(length).decode("latin-1"))
    if match is None:
        return None
    words = [word.strip() for word in match[3].split(",")]
    # Python writes a comma after the only element, and nothing between the brackets if there is none.
    numbers = [whole_number(word) for word in (words[:-1] if words[-1] == "" else words)]
    shape = tuple(number for number in numbers if number is not None)
    return _NpyHeader(match[1], match[2] == "True", shape) if len(shape) == len(numbers) else None


def _fill(values: np.ndarray, member: _Member) -> bool:
    """Whether a member holds as many bytes as there is room for, which it then fills."""
    position = 0
    while position < len(values):
        # Read at once, all bytes would be held twice, by `zipfile` and here.
        piece = member.read(min(len(values) - position, _MOST_AT_ONCE))
        if not piece:
            return False
        values[position : position + len(piece)] = np.frombuffer(piece, np.uint8)
        position += len(piece)
    # No byte may follow; and `zipfile` compares the checksum only when it comes to the end.
    return not member.read(1)


@contextmanager
def _damage_explained() -> Iterator[None]:
    """Whatever goes wrong inside is the archive's fault: to be used around calls of `zipfile` alone.

    It promises no set of exceptions for damaged bytes; more than ten kinds were seen.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError("the archive is damaged, or no .npz file at all") from error
