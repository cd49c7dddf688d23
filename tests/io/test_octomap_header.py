import struct

import pytest

from voxjax import InputError
from voxjax.io.octomap_header import BINARY_LINE, Header, read_header, read_legacy_header, write_header


@pytest.mark.parametrize("resolution", [0.1, 0.05, 1 / 3, 1e-3, 12.5])
def test_what_is_written_is_read(resolution):
    data = write_header(BINARY_LINE, 17, resolution)
    assert read_header(data + b"\ndata\n") == Header("OcTree", 17, resolution, len(data))
    assert data.startswith(BINARY_LINE + b"\n#")


def test_order_comments_and_unknown_lines_do_not_matter():
    data = b"# first\nres 0.5\n# size 3\n\nsize 4\ncolour blue\nid OcTree\ndata\nrest"
    assert read_header(data) == Header("OcTree", 4, 0.5, data.index(b"rest"))


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (b"id OcTree\nsize 1\nres 0.1\n", "no line 'data'"),
        (b"id OcTree\nres 0.1\ndata\n", "lacks the line 'size'"),
        (b"id Tree\nsize 1\nres 0.1\ndata\n", "'Tree'"),
        (b"id OcTree\nsize 1.5\nres 0.1\ndata\n", "whole number"),
        (b"id OcTree\nsize %s\nres 0.1\ndata\n" % (b"9" * 5000), "whole number"),
        (b"id OcTree\nsize 1\nres one\ndata\n", "must be a number"),
        (b"id OcTree\nsize 1\nres %s\ndata\n" % (b"9" * 5000), "the resolution must be"),
        (b"id %s\nsize 1\nres 1\ndata\n" % (b"x" * 5000), "must be one of"),
    ],
)
def test_headers_that_are_wrong_are_one_short_sentence(lines, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_header(BINARY_LINE + b"\n" + lines)
    assert len(str(caught.value)) < 300


def test_the_old_header_holds_resolution_and_size():
    data = struct.pack("<idI", 3, 0.25, 9)
    assert read_legacy_header(data + b"rest") == Header("OcTree", 9, 0.25, 16)
    for wrong in (data[:15], struct.pack("<idI", 4, 0.25, 9)):
        with pytest.raises(InputError, match="first line"):
            read_legacy_header(wrong)
    with pytest.raises(InputError, match="resolution"):
        read_legacy_header(struct.pack("<idI", 3, float("nan"), 9))
