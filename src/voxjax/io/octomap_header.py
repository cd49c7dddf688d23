"""Headers of OctoMap files: text lines up to `data`, or the few bytes of files from before OctoMap 1.0."""

import struct
from typing import NamedTuple

from .._checks import InputError, check_voxel_size, shown
from .text_header import header_lines, whole_number

BINARY_LINE, FULL_LINE = b"# Octomap OcTree binary file", b"# Octomap OcTree file"


class Header(NamedTuple):
    """What a header says.

    Attributes:
        tree_type: Name of the kind of nodes, such as "OcTree".
        num_nodes: Number of inner nodes and leaves.
        resolution: Edge length of a voxel [m].
        start: Where the data begin [byte].
    """

    tree_type: str
    num_nodes: int
    resolution: float
    start: int


def write_header(first_line: bytes, num_nodes: int, resolution: float) -> bytes:
    """Bytes of the header of a plain tree, up to the data."""
    # OctoMap prints six digits; all digits are given where six are not enough to get the same number back.
    short = f"{resolution:g}"
    text = short if float(short) == resolution else repr(float(resolution))
    lines = (
        first_line,
        b"# (feel free to add / change comments, but leave the first line as it is!)\n#",
        b"id OcTree",
        b"size %d" % num_nodes,
        b"res " + text.encode(),
        b"data",
        b"",
    )
    return b"\n".join(lines)


def read_header(data: bytes) -> Header:
    """Read a text header.

    Raises:
        InputError: If it does not end, or a line is missing or wrong.
    """
    fields: dict[str, str] = {}
    for words, position in header_lines(data):
        if words and words[0] == "data":
            return _checked_fields(fields, position)
        # Lines that are not known are passed over: other versions of OctoMap may write more of them.
        if len(words) >= 2 and not words[0].startswith("#"):
            fields[words[0]] = words[1]
    raise InputError("the header has no line 'data' (truncated or not an OctoMap file)")


def _checked_fields(fields: dict[str, str], start: int) -> Header:
    missing = [name for name in ("id", "size", "res") if name not in fields]
    if missing:
        raise InputError(f"the header lacks the line {missing[0]!r}")
    # Early versions wrote "1" for OcTree.
    tree_types = ("OcTree", "1", "OcTreeStamped", "ColorOcTree")
    if fields["id"] not in tree_types:
        raise InputError(f"the header's id must be one of {', '.join(tree_types)}, got {shown(fields['id'])}")
    size = whole_number(fields["size"])
    if size is None:
        raise InputError(f"the header's size must be a whole number, got {shown(fields['size'])}")
    try:
        resolution = float(fields["res"])
    except ValueError:
        raise InputError(f"the header's res must be a number, got {shown(fields['res'])}") from None
    return Header(fields["id"], size, check_voxel_size(resolution, "the resolution"), start)


def read_legacy_header(data: bytes) -> Header:
    """Read the header of a binary file from before OctoMap 1.0.

    Raises:
        InputError: If it is none.
    """
    fields = struct.Struct("<idI")  # tree type 3, resolution, number of nodes
    # Such a file has no first line of text, so that the number of its tree type has to tell what it is.
    if len(data) < fields.size or data[:4] != b"\x03\x00\x00\x00":
        raise InputError(
            f"the first line must be {BINARY_LINE.decode()!r}, and there is no old-style header either"
        )
    _, resolution, size = fields.unpack_from(data)
    return Header("OcTree", size, check_voxel_size(resolution, "the resolution"), fields.size)
