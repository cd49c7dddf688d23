import tracemalloc

import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.io.ply import decode_ply, encode_ply
from voxjax.ops.blocks.voxel_list import blocks_with

POINTS = np.array([[0.5, -1.25, 3.0], [2.0, 0.0, -7.5], [1e-3, 8.0, 9.0]])


def header(form: str, *lines: str) -> bytes:
    return "\n".join(["ply", f"format {form} 1.0", *lines, "end_header", ""]).encode()


def binary(order: str, code: str) -> bytes:
    form, kind = {"<": "little", ">": "big"}[order], {"f4": "float", "f8": "double"}[code]
    row = np.dtype(
        [("x", order + code), ("label", "u1"), ("z", order + code), ("y", order + code), ("id", order + "i4")]
    )
    rows = np.zeros(3, row)
    rows["x"], rows["y"], rows["z"], rows["label"], rows["id"] = *POINTS.T, 7, 70000
    names = [
        f"property {kind} x",
        "property uchar label",
        f"property {kind} z",
        f"property {kind} y",
        "property int id",
    ]
    lead = np.arange(4, dtype=order + "u2").tobytes()
    lines = (
        "comment made by hand",
        "element camera 2",
        "property ushort a",
        "property ushort b",
        "element vertex 3",
        *names,
    )
    return header(f"binary_{form}_endian", *lines) + lead + rows.tobytes()


XYZ = ("property float x", "property float y", "property float z")
ASCII = header("ascii", "element vertex 2", *XYZ, "property list uchar int ids")
TWO = header("binary_little_endian", "element vertex 2", *XYZ)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("code", ["f4", "f8"])
def test_binary_clouds_of_either_byte_order_skip_what_is_no_coordinate(order, code):
    points = decode_ply(binary(order, code))
    assert points.dtype == np.dtype(code)
    np.testing.assert_array_equal(points, POINTS.astype(code))


@pytest.mark.parametrize("newline", [b"\n", b"\r\n"])
def test_ascii_clouds_with_faces_after_the_vertices(newline):
    head = header(
        "ascii", "element vertex 2", "property uchar red", *XYZ, "element face 1", "property list uchar int i"
    )
    data = head + b"255 1 2.5 -3\n0 4e1 5 6\n3 0 1 1\n"
    np.testing.assert_array_equal(decode_ply(data.replace(b"\n", newline)), [[1, 2.5, -3], [40, 5, 6]])


def test_binary_faces_after_the_vertices_are_left_alone():
    lines = ("element vertex 1", *XYZ, "element face 1", "property list uchar int vertex_indices")
    data = header("binary_little_endian", *lines) + np.array([1, 2, 3], "<f4").tobytes() + bytes(13)
    np.testing.assert_array_equal(decode_ply(data), [[1, 2, 3]])


def test_a_grid_is_written_as_the_centres_of_its_occupied_voxels():
    states = np.random.default_rng(0).integers(0, 3, (4, 5, 6)).astype(np.uint8)
    grid = VoxelGrid(states, [1.0, -2.0, 0.5], 0.5)
    data = encode_ply(grid)
    points = decode_ply(data)
    np.testing.assert_array_equal(points, np.argwhere(states == 2) * 0.5 + np.array([1.25, -1.75, 0.75]))
    assert b"binary_little_endian" in data


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "first line"),
        (b"plywood", "first line"),
        (b"ply\nformat ascii 1.0\n", "end_header"),
        (header("ascii", "format ascii 1.0", "element vertex 0", *XYZ), "two lines 'format'"),
        (header("binary_middle_endian", "element vertex 0", *XYZ), "format must be"),
        (header("ascii", "element face 0"), "element 'vertex'"),
        (header("ascii", "element vertex minus"), "cannot be understood"),
        (header("ascii", "element vertex " + "9" * 5000), "cannot be understood"),
        (header("ascii", "element vertex 1", *XYZ[:2]) + b"1 2\n", "no number 'z'"),
        (header("ascii", "element vertex 1", *XYZ, "property quad w"), "unknown type"),
        (ASCII + b"1 2 3 0\n1 2 3 0\n", "lists"),
        (header("ascii", "element vertex 2", *XYZ) + b"1 2 3\n", "1 lines follow"),
        (header("ascii", "element vertex 1", *XYZ) + b"1 2 3\n4 5 6\n", "2 lines follow"),
        (header("ascii", "element vertex 1", *XYZ) + b"1 2\n", "3 numbers"),
        (header("ascii", "element vertex 1", *XYZ) + b"1 2 three\n", "3 numbers .*'three'"),
        (TWO + np.zeros(5, "<f4").tobytes(), "truncated"),
        (TWO + np.zeros(7, "<f4").tobytes(), "4 bytes follow"),
        (header("binary_little_endian", "element vertex 99999999999999", *XYZ), "truncated"),
        (
            header("binary_big_endian", "element f 0", "property list int int i", "element vertex 0", *XYZ),
            "cannot be skipped",
        ),
    ],
)
def test_unusable_bytes_are_refused_in_one_sentence(data, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        decode_ply(data)
    assert "\n" not in str(caught.value)


def test_a_word_of_any_length_is_one_number_or_none():
    head = header("ascii", "element vertex 1001", *XYZ)
    lines = b"1 2 3\n" * 1000
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="each vertex must have 3 numbers"):
            decode_ply(head + lines + b"1 2 " + b"x" * 100_000 + b"\n")
        assert np.isinf(decode_ply(head + lines + b"1 2 " + b"9" * 100_000 + b"\n")[-1, 2])
        assert tracemalloc.get_traced_memory()[1] < 3_000_000
    finally:
        tracemalloc.stop()


def test_what_is_no_place_is_read_as_it_stands():
    text = header("ascii", "element vertex 2", *XYZ) + b"1 2 nan\n-inf 1e39 3\n"
    for data in (text, TWO + np.array([1, 2, np.nan, -np.inf, np.inf, 3], "<f4").tobytes()):
        np.testing.assert_array_equal(decode_ply(data), [[1, 2, np.nan], [-np.inf, np.inf, 3]])


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_cloud_of_no_points_is_read(form):
    assert decode_ply(header(form, "element vertex 0", *XYZ)).shape == (0, 3)


def test_rows_of_unequal_lengths_are_refused_though_their_sum_fits():
    with pytest.raises(InputError, match="3 numbers"):
        decode_ply(header("ascii", "element vertex 2", *XYZ) + b"1 2\n3 4 5 6\n")


def test_lines_of_other_blanks_are_no_vertices():
    head = header("ascii", "element vertex 2", *XYZ)
    np.testing.assert_array_equal(
        decode_ply(head + b"\x0b\n1 2 3\n\xa0\n4 5 6\n\x1c"), [[1, 2, 3], [4, 5, 6]]
    )


def test_a_box_of_more_voxels_than_int32_counts_is_written_by_what_is_occupied():
    index = np.array([[0, 0, 0], [3, 1, 2], [90_000, 40_000, 99]])
    grid = VoxelGrid(blocks_with(index, np.uint8(2), (90_001, 40_001, 100)), [0.5, -1.0, 0.0], 0.5)
    points = decode_ply(encode_ply(grid))
    np.testing.assert_allclose(points, 0.5 * index + [0.75, -0.75, 0.25])
