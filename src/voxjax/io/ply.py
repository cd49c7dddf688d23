"""Point clouds in `.ply` files: ASCII and binary, either byte order; written as binary, little endian."""

import io
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np

from .._checks import InputError, shown
from .._runtime.memory import check_memory
from ..frames import float32_tells
from ..grid import VoxelGrid
from .budget import Budget
from .text_header import header_lines, whole_number

# Both families of names are in use: those of C, and those that say their width.
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_BYTE_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class Element(NamedTuple):
    """One element of the header.

    Attributes:
        name: Name of the element, such as "vertex".
        count: Number of rows.
        properties: Names and NumPy type codes; the code is None for a list.
    """

    name: str
    count: int
    properties: list[tuple[str, str | None]]


def decode_ply(data: bytes) -> np.ndarray:
    """Read the points of a `.ply` file.

    Other properties and elements are skipped.

    Returns:
        (n, 3), float64 where the file has doubles, else float32 [m]; NaN and infinite as they stand in the file.

    Raises:
        InputError: If the header is wrong, the file is shorter or longer than the header says, or the vertices
            hold lists.
    """
    # The most that was seen: a row of three bytes becomes three numbers of eight, twice.
    Budget(len(data)).check(16 * len(data), "reading the cloud")
    form, elements, start = _read_header(data)
    names = [element.name for element in elements]
    if names.count("vertex") != 1:
        raise InputError("the header must have one element 'vertex'")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    # A dictionary loses one of two equal names, which the lengths tell below.
    properties = dict(vertex.properties)
    for axis in "xyz":
        if properties.get(axis) is None:
            raise InputError(f"the vertices have no number {axis!r}")
    if None in properties.values():
        raise InputError("the vertices hold lists, which cannot be read; write the cloud with numbers only")
    if len(properties) < len(vertex.properties):
        raise InputError("the vertices have two properties of the same name")
    # After the last element nothing may follow; what follows after others may be lists of any length.
    is_last = len(elements) == len(before) + 1
    if form == "ascii":
        return _read_ascii(data, start, before, vertex, is_last)
    return _read_binary(data, start, before, vertex, is_last, _BYTE_ORDER[form])


def encode_ply(grid: VoxelGrid) -> bytes:
    """Bytes of the `.ply` cloud of the centres of the occupied voxels [m], binary little endian.

    Numbers are float32, which most clouds have, and float64 where float32 would move a centre by more than a hundredth
    of a voxel.

    Raises:
        InputError: If there is not enough memory.
    """
    # Places in float64 and as they are written, and the bytes of the file: 72 bytes for a point far out.
    check_memory(75.0 * grid.num_occupied, "the cloud", "write the map as .npz", on_device=False)
    points = grid.occupied_points()
    is_far = not float32_tells(float(np.abs(points).max(initial=0.0)), grid.voxel_size)
    points = points.astype("<f8" if is_far else "<f4")
    kind = "double" if is_far else "float"
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [*(f"property {kind} {axis}" for axis in "xyz"), "end_header", ""]
    return "\n".join(lines).encode() + points.tobytes()


def _read_ascii(data: bytes, start: int, before: list[Element], vertex: Element, is_last: bool) -> np.ndarray:
    """Points (n, 3) of a file of text."""
    # A line holds one row of whatever element, lists included, so elements before the vertices are skipped by counting.
    first, width = sum(element.count for element in before), len(vertex.properties)
    # Rows are counted before they are read, for `loadtxt` would take fewer for a whole cloud.
    num_rows = sum(1 for _ in _rows(data, start)) - first
    if num_rows < vertex.count or (is_last and num_rows > vertex.count):
        raise InputError(f"the header says {vertex.count:,} vertices, but {max(num_rows, 0):,} lines follow")
    # NumPy warns about a table without rows, so it is only asked for one that has some.
    table = np.zeros((0, width))
    if vertex.count:
        try:
            rows = islice(_rows(data, start), first, first + vertex.count)
            # No sign starts a comment among the rows of a cloud.
            table = np.loadtxt(rows, comments=None, ndmin=2)
        except ValueError as error:
            reason = str(error).partition(";")[0][:120].rstrip(".")
            raise InputError(f"each vertex must have {width} numbers ({reason})") from error
    if table.shape[1] != width:
        raise InputError(f"each vertex must have {width} numbers, but they have {table.shape[1]}")
    types = dict(vertex.properties)
    dtype = np.float64 if any(types[axis] == "f8" for axis in "xyz") else np.float32
    columns = [name for name, _ in vertex.properties]
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite
        return table[:, [columns.index(axis) for axis in "xyz"]].astype(dtype)


def _rows(data: bytes, start: int) -> Iterator[str]:
    """Lines that hold more than blanks, as `np.loadtxt` sees them."""
    file = io.BytesIO(data)
    file.seek(start)
    return (text for line in file if (text := line.decode("latin-1").strip()))


def _read_binary(
    data: bytes, start: int, before: list[Element], vertex: Element, is_last: bool, byte_order: str
) -> np.ndarray:
    # Elements stand one after the other, and only those of rows of one length can be skipped without reading them.
    for element in before:
        codes = [code for _, code in element.properties]
        if None in codes:
            raise InputError(
                f"the element {shown(element.name)} before the vertices holds lists, which cannot be skipped"
            )
        start += element.count * sum(np.dtype(code).itemsize for code in codes)
    row = np.dtype([(name, f"{byte_order}{code}") for name, code in vertex.properties])
    num_bytes = len(data) - start
    if num_bytes < vertex.count * row.itemsize:
        raise InputError(
            f"the header says {vertex.count:,} vertices of {row.itemsize} bytes, "
            "but the data end before (truncated)"
        )
    if is_last and num_bytes > vertex.count * row.itemsize:
        raise InputError(f"{num_bytes - vertex.count * row.itemsize} bytes follow after the last vertex")
    # The records are read where they lie in the file, and only coordinates are copied.
    table = np.frombuffer(data, row, count=vertex.count, offset=start)
    dtype = np.float64 if any(table[axis].dtype.itemsize == 8 for axis in "xyz") else np.float32
    return np.stack([table[axis].astype(dtype) for axis in "xyz"], axis=1)


def _read_header(data: bytes) -> tuple[str, list[Element], int]:
    """Format, elements and start of the data."""
    # Lines end with a carriage return too where the file was written on Windows.
    if data[:4] not in (b"ply\n", b"ply\r"):
        raise InputError("the first line must be 'ply'")
    form, elements = "", []
    for words, position in header_lines(data):
        if words == ["end_header"]:
            if form not in _BYTE_ORDER:
                raise InputError(f"the format must be one of {', '.join(_BYTE_ORDER)}, got {shown(form)}")
            return form, elements, position
        count = whole_number(words[2]) if words[:1] == ["element"] and len(words) == 3 else None
        if words[:1] == ["format"] and len(words) == 3:
            if form:
                raise InputError("the header has two lines 'format'")
            form = words[1]
        elif count is not None:
            elements.append(Element(words[1], count, []))
        elif words[:1] == ["property"] and elements and len(words) >= 3:
            elements[-1].properties.append((words[-1], _type_code(words)))
        elif words[:1] not in (["comment"], ["obj_info"], []):
            raise InputError(f"the header line {shown(' '.join(words))} cannot be understood")
    raise InputError("the header has no line 'end_header' (truncated or not a PLY file)")


def _type_code(words: list[str]) -> str | None:
    if words[1] == "list":
        return None
    if len(words) != 3 or words[1] not in _TYPES:
        raise InputError(f"the property {shown(' '.join(words[1:]))} has an unknown type")
    return _TYPES[words[1]]
