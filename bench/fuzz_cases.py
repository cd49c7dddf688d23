"""Damaged map files: small files that are right, and edits that break them in many ways.

Edits are plain numbers, so that a generator of random numbers and Hypothesis draw the same ones.
"""

import io
import re
import shutil
import struct
import tempfile
import zipfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from voxjax import VoxelGrid, write_map
from voxjax.io.npz import encode_npz
from voxjax.io.octomap import encode_bt, encode_ot
from voxjax.io.ply import encode_ply

READERS = ("npz", "ply", "bt", "ot", "zarr")
KINDS = ("flip", "byte", "integer", "number", "text", "insert", "drop", "repeat", "cut", "splice")

_INTEGERS = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    2**63 - 1,
    2**64 - 1,
)
_NUMBERS = (
    *(b"0", b"1", b"-1", b"2", b"65535", b"65536", b"1023", b"2147483648", b"4294967295", b"99999999999"),
    *(
        b"18446744073709551616",
        b"9" * 400,
        b"9" * 5000,
        b"0.0000001",
        b"1e-300",
        b"1e300",
        b"1e999",
        b"nan",
        b"inf",
    ),
    *(b"-0.0", b"0x10", b"1_0", b"\xd9\xa3", b"True"),
)
_TEXTS = (
    *(
        b"(" * 300,
        b"[" * 5000,
        b"'",
        b'"',
        b"\\",
        b"\0",
        b"\n",
        b"\r",
        b"\n" * 1000,
        b" " * 70_000,
        b"x" * 100_000,
    ),
    *(b"element vertex 0\n", b"element a 9999999\n", b"property list uchar int x\n", b"property double x\n"),
    *(b"format ascii 1.0\n", b"format binary_big_endian 1.0\n", b"end_header\n", b"comment \xff\n"),
    *(b"\ndata\n", b"id ColorOcTree\n", b"size 0\n", b"res 1e-30\n", b"\xff\xff" * 400, b"\x03\x00" * 30),
    *(
        b"'descr': '|O', ",
        b"'shape': (1,), ",
        b"'fortran_order': True, ",
        b"|O",
        b"<f8",
        b"(1024, 1024, 1024)",
    ),
)


class Edit(NamedTuple):
    """One change of a file.

    Attributes:
        kind: One of `KINDS`.
        place: Where, as a share of the length, in [0, 1).
        size: How many bytes, where that can be chosen.
        value: What is written, or which of several things.
        is_inside: For archives of .npz, whether a file in it is changed and packed anew; for trees, whether the header
            says how many nodes there are after the change.
    """

    kind: str
    place: float
    size: int
    value: int
    is_inside: bool


@cache
def right_files(reader: str) -> tuple[bytes, ...]:
    """Small files that a reader takes."""
    grid = _grid()
    plain = VoxelGrid(grid.states, grid.origin, grid.voxel_size)
    if reader == "npz":
        return encode_npz(plain), encode_npz(grid), _saved_by_numpy(grid)
    if reader == "bt":
        data = encode_bt(plain)
        start = data.index(b"\ndata\n") + 6
        size = int(data.split(b"size ")[1].split()[0])
        return data, struct.pack("<idI", 3, 0.1, size) + data[start:]
    if reader == "zarr":
        return _packed_store(grid), _packed_store(plain), _store_of_zarr(plain)
    if reader == "ot":
        return encode_ot(grid), _colored(encode_ot(plain))
    return encode_ply(plain), _ascii_cloud(), _cloud_of_doubles()


def draw(rng: np.random.Generator) -> list[Edit]:
    """A few edits, at random."""
    return [
        Edit(
            KINDS[rng.integers(len(KINDS))],
            float(rng.random() ** rng.choice([1.0, 4.0])),  # headers stand at the beginning
            int(rng.integers(65)),
            int(rng.integers(2**32)),
            bool(rng.random() < 0.7),
        )
        for _ in range(min(rng.geometric(0.6), 8))
    ]


def damaged(reader: str, number: int, edits: Sequence[Edit]) -> bytes:
    """The right file of this number, edited."""
    files = right_files(reader)
    data, other = files[number % len(files)], files[(number + 1) % len(files)]
    for edit in edits:
        inside = reader == "zarr" or (reader == "npz" and edit.is_inside)
        changed = _edited_inside(data, edit) if inside else None
        data = _edited(data, other, edit) if changed is None else changed
    is_counted = reader in ("bt", "ot") and edits and edits[0].is_inside
    return _with_right_size(data, reader) if is_counted else data


def _edited(data: bytes, other: bytes, edit: Edit) -> bytes:
    at = int(edit.place * len(data))
    end, value = at + edit.size, edit.value
    match edit.kind:
        case "flip":
            return data[:at] + bytes([data[at] ^ 1 << value % 8]) + data[at + 1 :] if data else data
        case "byte":
            return data[:at] + bytes([value % 256]) + data[at + 1 :]
        case "integer":
            width = (2, 4, 8)[value % 3]
            number = _INTEGERS[value // 3 % len(_INTEGERS)] % (1 << 8 * width)
            return data[:at] + number.to_bytes(width, "little") + data[at + width :]
        case "number":
            start, stop = _digits_near(data, at)
            return data[:start] + _NUMBERS[value % len(_NUMBERS)] + data[stop:]
        case "text":
            return data[:at] + _TEXTS[value % len(_TEXTS)] + data[at:]
        case "insert":
            return data[:at] + value.to_bytes(4, "little") * (edit.size // 4 + 1) + data[at:]
        case "drop":
            return data[:at] + data[end:]
        case "repeat":
            return data[:at] + data[at:end] * (1 + value % 50) + data[end:]
        case "cut":
            return data[:at]
        case _:
            return data[:at] + other[value % (len(other) + 1) :]


def _edited_inside(archive: bytes, edit: Edit) -> bytes | None:
    """The archive with one of its files edited; None if it is none any more."""
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as file:
            contents = {name: file.read(name) for name in file.namelist()}
    except Exception:  # an edit before this one has broken it
        return None
    if not contents:
        return None
    name = sorted(contents)[edit.value // 7 % len(contents)]
    contents[name] = _edited(contents[name], next(iter(contents.values())), edit)
    plain, packed = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
    methods = (packed, packed, plain, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, content in contents.items():
            entry = zipfile.ZipInfo(name)  # its date is fixed, so that the same edits give the same bytes
            file.writestr(entry, content, methods[edit.value % len(methods)])
    return buffer.getvalue()


def _with_right_size(data: bytes, reader: str) -> bytes:
    """An OctoMap file whose header says how many nodes the data hold; readers look no further otherwise."""
    head, mark, body = data.partition(b"\ndata\n")
    if not mark:
        return data
    if reader == "bt":
        codes = (
            np.frombuffer(body[: len(body) // 2 * 2], "<u2")[:, None] >> np.arange(0, 16, 2, dtype=np.uint16)
            & 3
        )
        number = 1 + int(np.count_nonzero(codes))
    else:
        number = len(body) // (8 if b"ColorOcTree" in head else 5)
    return re.sub(rb"size \d+", b"size %d" % number, head, count=1) + mark + body


def _digits_near(data: bytes, at: int) -> tuple[int, int]:
    """Begin and end of the first run of digits from a place on; the place itself if there is none."""
    start = next((i for i in range(at, min(len(data), at + 200)) if data[i : i + 1].isdigit()), at)
    stop = start
    while data[stop : stop + 1].isdigit():
        stop += 1
    return start, stop


def _grid() -> VoxelGrid:
    rng = np.random.default_rng(0)
    states = rng.integers(0, 3, (4, 4, 3)).astype(np.uint8).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    states[rng.random(states.shape) < 0.1] = 2
    value = rng.integers(1, 4, states.shape).astype(np.float32)
    log_odds = np.where(states == 2, value, np.where(states == 1, -value, np.float32(0)))
    return VoxelGrid(states, np.array([-5, 3, -2]) * 0.1, 0.1, log_odds)


def _packed_store(grid: VoxelGrid) -> bytes:
    """A store, which is a folder, as an archive, of which `put` makes the folder."""
    with tempfile.TemporaryDirectory() as folder:
        write_map(Path(folder) / "m.zarr", grid)
        return _packed(Path(folder) / "m.zarr")


def _store_of_zarr(grid: VoxelGrid) -> bytes:
    """A store as zarr writes it, with chunks in files of their own and another codec."""
    import zarr.codecs

    place = {"origin": np.asarray(grid.origin).tolist(), "voxel_size": grid.voxel_size}
    with tempfile.TemporaryDirectory() as folder:
        group = zarr.create_group(Path(folder) / "m.zarr", attributes={"voxjax_map": 1, **place})
        options = {"chunks": (4, 4, 3), "compressors": zarr.codecs.GzipCodec(), "fill_value": 0}
        group.create_array("states", data=np.asarray(grid.states), **options)
        return _packed(Path(folder) / "m.zarr")


def _packed(folder: Path) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file():  # dates are fixed, as in `_edited_inside`
                file.writestr(zipfile.ZipInfo(path.relative_to(folder).as_posix()), path.read_bytes())
    return buffer.getvalue()


def put(path: Path, data: bytes) -> None:
    """Write a file that was damaged, or the folder of a store, in place of what is there."""
    if path.suffix != ".zarr":
        path.write_bytes(data)
        return
    shutil.rmtree(path, ignore_errors=True)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        archive.extractall(path)


def _saved_by_numpy(grid: VoxelGrid) -> bytes:
    buffer = io.BytesIO()
    np.savez(
        buffer,
        voxjax_map=np.int32(2),
        states=np.asfortranarray(np.asarray(grid.states)),
        origin=np.asarray(grid.origin),
        voxel_size=np.float64(grid.voxel_size),
    )
    return buffer.getvalue()


def _colored(data: bytes) -> bytes:
    start = data.index(b"\ndata\n") + 6
    plain = np.frombuffer(data[start:], np.dtype([("value", "<f4"), ("mask", "u1")]))
    nodes = np.zeros(len(plain), np.dtype([("value", "<f4"), ("rgb", "u1", 3), ("mask", "u1")]))
    nodes["value"], nodes["mask"] = plain["value"], plain["mask"]
    return data[:start].replace(b"id OcTree", b"id ColorOcTree") + nodes.tobytes()


def _ascii_cloud() -> bytes:
    lines = ["ply", "format ascii 1.0", "comment made by hand", "element camera 1", "property uchar id"]
    lines += ["element vertex 5", "property uchar red", *(f"property float {axis}" for axis in "xyz")]
    lines += ["element face 1", "property list uchar int vertex_indices", "end_header", "7"]
    lines += [f"255 {x}.5 -1.25e0 {x / 7:.6f}" for x in range(5)] + ["3 0 1 2", ""]
    return "\n".join(lines).encode()


def _cloud_of_doubles() -> bytes:
    row = np.dtype([("x", ">f8"), ("label", "u1"), ("z", ">f8"), ("y", ">f8")])
    rows = np.zeros(6, row)
    rows["x"], rows["y"], rows["z"] = np.random.default_rng(0).normal(size=(3, 6))
    lines = [
        "ply",
        "format binary_big_endian 1.0",
        "element camera 2",
        "property ushort a",
        "element vertex 6",
    ]
    lines += [
        "property double x",
        "property uchar label",
        "property double z",
        "property double y",
        "end_header",
    ]
    return "\n".join([*lines, ""]).encode() + bytes(4) + rows.tobytes()
