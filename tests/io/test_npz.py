import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.io import describe_map, load_map
from voxjax.io.npz import decode_npz, encode_npz
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of


def make_grid(with_log_odds=False) -> VoxelGrid:
    rng = np.random.default_rng(0)
    states = rng.integers(0, 3, (5, 6, 7)).astype(np.uint8)
    log_odds = rng.normal(size=states.shape).astype(np.float32) if with_log_odds else None
    return VoxelGrid(states, [0.03, -2.0, 1e3], 0.1, log_odds)


def members(**changes) -> bytes:
    """The bytes of a map file with some arrays exchanged (None: left out)."""
    arrays = {
        "voxjax_map": np.int32(1),
        "states": np.zeros((2, 2, 2), np.uint8),
        "origin": np.zeros(3, np.float32),
        "voxel_size": np.float64(0.1),
    } | changes
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=True, **{k: v for k, v in arrays.items() if v is not None})
    return buffer.getvalue()


def bomb() -> bytes:
    """A member whose header promises 65536³ voxels and holds none."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|u1", "fortran_order": False, "shape": (65536, 65536, 65536)}
    )
    buffer = io.BytesIO(members(states=None))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr("states.npy", header.getvalue())
    return buffer.getvalue()


def with_member(content: bytes, *, name="states", method=zipfile.ZIP_DEFLATED) -> bytes:
    """A map file one of whose arrays is replaced by bytes."""
    buffer = io.BytesIO(members(**{name: None}))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(f"{name}.npy", content, method)
    return buffer.getvalue()


def npy(header: str, values: bytes = b"") -> bytes:
    """An array's file with any header."""
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header.encode() + values


def shaped(shape: str) -> str:
    return f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({shape}), }}"


@pytest.mark.parametrize("with_log_odds", [False, True])
def test_there_and_back_is_the_same_grid(with_log_odds):
    grid = make_grid(with_log_odds)
    assert decode_npz(encode_npz(grid)) == grid


def test_equal_grids_give_equal_bytes():
    assert encode_npz(make_grid(True)) == encode_npz(make_grid(True))


def test_numpy_reads_the_file_and_its_own_files_are_read():
    grid = make_grid()
    with np.load(io.BytesIO(encode_npz(grid)), allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["states"], grid.states)
    assert decode_npz(members()).shape == (2, 2, 2)
    fortran = np.asfortranarray(np.asarray(grid.states))
    np.testing.assert_array_equal(decode_npz(members(states=fortran)).states, grid.states)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "damaged"),
        (b"not a zip file at all", "damaged"),
        (encode_npz(make_grid())[:-30], "damaged"),
        (members(states=None), "no array 'states'"),
        (members(voxjax_map=None), "no voxjax map"),
        (members(voxjax_map=np.int32(3)), "version 3"),
        (members(states=np.zeros((2, 2), np.uint8)), "3 axes"),
        (members(states=np.zeros((2, 2, 2), np.float32)), "type uint8"),
        (members(states=np.full((2, 2, 2), 3, np.uint8)), "got 3"),
        (members(states=np.array([[[{}]]])), "states"),
        (members(origin=np.array([0, np.nan, 0], np.float32)), "origin must be finite"),
        (members(origin=np.zeros(2, np.float32)), "origin"),
        (members(origin=np.zeros(3)), "'origin' must have type float32"),
        (members(voxjax_map=np.int32(2)), "'origin' must have type float64"),
        (members(voxel_size=np.float64(-1)), "voxel_size"),
        (members(log_odds=np.full((2, 2, 2), np.nan, np.float32)), "NaN"),
        (members(log_odds=np.zeros((2, 2, 1), np.float32)), "log_odds"),
        (bomb(), "more than the limit"),
    ],
)
def test_unusable_bytes_are_refused_in_one_sentence(data, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        decode_npz(data)
    assert "\n" not in str(caught.value)


def test_a_damaged_file_gives_the_map_or_one_sentence():
    rng = np.random.default_rng(1)
    data = encode_npz(make_grid(True))
    for _ in range(500):
        damaged = bytearray(data)
        for position in rng.integers(0, len(data), 4):
            damaged[position] = rng.integers(0, 256)
        try:
            decode_npz(bytes(damaged), max_voxels=10**6)
        except InputError:
            continue


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_that_pack_a_million_bytes_into_one_are_refused(method):
    with pytest.raises(InputError, match="compressed in a way that"):
        decode_npz(with_member(npy(shaped("1, 1, 1"), b"\2"), method=method))


@pytest.mark.parametrize(
    "header",
    [
        "",
        "{",
        "(" * 3000,
        "{'descr': (",
        "{'descr': '|u1', 'fortran_order': False, 'shape': ",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 1, 1), }['x']",
        shaped("9" * 3000 + ", 1, 1"),
        shaped("1, 1, -1"),
        shaped("1 1 1"),
        shaped("1,, 1, 1"),
        shaped("True, 1, 1"),
        shaped(" " * 5000 + "1, 1, 1"),
    ],
)
def test_headers_that_are_none_are_refused(header):
    with pytest.raises(InputError, match="the array 'states' has no valid header"):
        decode_npz(with_member(npy(header, b"\2")))


@pytest.mark.parametrize(
    "header", [shaped("1, 1, 1"), "{'descr':'<u1','fortran_order':True,'shape':(1,1,1)}\n"]
)
def test_headers_of_other_writers_are_read(header):
    assert decode_npz(with_member(npy(header, b"\2"))).num_occupied == 1


def test_a_header_that_never_ends_takes_no_memory():
    data = with_member(npy(shaped("1, 1, 1") + " " * 50_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="no valid header"):
            decode_npz(data)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_objects_and_other_types_are_refused_before_they_are_read():
    for descr in ("|O", ">i4", "<f4"):
        header = shaped("1, 1, 1").replace("|u1", descr)
        with pytest.raises(InputError, match="must have type uint8"):
            decode_npz(with_member(npy(header, bytes(8))))


def test_a_small_archive_cannot_ask_for_much_memory():
    with pytest.raises(InputError, match=r"the map of 1024 x 1024 x 1000 voxels needs .* a file of"):
        decode_npz(with_member(npy(shaped("1024, 1024, 1000"))))
    data = with_member(npy(shaped("10, 10, 10"), bytes(50_000_000)))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="not as long as its shape says"):
            decode_npz(data)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_an_empty_map_as_large_as_its_archive_can_hold_is_read():
    states = np.zeros((1000, 100, 600), np.uint8)
    data = members(states=states)
    assert len(data) < states.size / 900
    assert decode_npz(data, max_voxels=states.size).shape == states.shape
    assert decode_npz(data).shape == states.shape


def test_a_table_of_contents_of_thousands_of_entries_is_refused():
    buffer = io.BytesIO(members())
    with zipfile.ZipFile(buffer, "a") as archive:
        for number in range(100):
            archive.writestr(f"{number:030000d}", b"")
    with pytest.raises(InputError, match="table of contents"):
        decode_npz(buffer.getvalue())


def test_states_take_no_more_memory_than_their_number(monkeypatch):
    data = members(states=np.zeros((300, 300, 300), np.uint8))
    monkeypatch.setenv("VOXJAX_MEMORY", "0.0271")
    assert decode_npz(data).shape == (300, 300, 300)
    tracemalloc.start()
    try:
        decode_npz(data)
        assert tracemalloc.get_traced_memory()[1] < 1.2 * 27e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "shape", [(5, 6, 7), (130, 3, 70), (2, 1, 20_000), (20_000, 2, 1), (1, 9000, 2), (0, 3, 2)]
)
def test_the_first_index_may_run_fastest(shape):
    states = np.random.default_rng(0).integers(0, 3, shape).astype(np.uint8)
    found = decode_npz(members(states=np.asfortranarray(states))).states
    np.testing.assert_array_equal(found, states)
    assert np.asarray(found).flags.c_contiguous


def test_locked_and_doubled_arrays_are_refused_in_our_words():
    with pytest.warns(UserWarning, match="Duplicate name"):
        doubled = doubled_states()
    with pytest.raises(InputError, match="two arrays of the same name"):
        decode_npz(doubled)
    locked = bytearray(members())
    # The flags of the first entry stand 8 bytes after the signature of its row in the table of contents.
    locked[locked.find(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(InputError, match="'voxjax_map' is encrypted; write"):
        decode_npz(bytes(locked))


def doubled_states() -> bytes:
    """A map file with two members of the name states.npy."""
    buffer = io.BytesIO(members())
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr("states.npy", b"")
    return buffer.getvalue()


@pytest.mark.parametrize("shape", [(0, 3, 2), (1, 1, 1), (41, 9, 30)])
def test_a_map_in_blocks_gives_the_bytes_of_the_dense_one(shape):
    rng = np.random.default_rng(0)
    states = rng.integers(0, 3, shape).astype(np.uint8)
    odds = rng.normal(0, 1, shape).astype(np.float32)
    dense = VoxelGrid(states, [1.0, 2.0, 3.0], 0.25, odds)
    sparse = VoxelGrid(blocks_of(states), [1.0, 2.0, 3.0], 0.25, blocks_of(odds))
    data = encode_npz(sparse)
    assert data == encode_npz(dense)
    if all(shape):
        with np.load(io.BytesIO(data)) as found:
            np.testing.assert_array_equal(found["states"], states)
            np.testing.assert_array_equal(found["log_odds"], odds)


def test_a_box_of_more_voxels_than_a_file_holds_is_refused_with_the_formats_that_can():
    far = VoxelGrid(BlockBuilder((1 << 14, 1 << 14, 8), np.uint8).finish(), np.zeros(3), 0.1)
    with pytest.raises(
        InputError, match=r"at most 2,147,483,647, and this one has 2,147,483,648; write it as \.bt"
    ):
        encode_npz(far)


def test_what_version_1_has_lost_of_a_far_origin_is_said(tmp_path):
    heard = []
    far = members(origin=np.array([450_000.1, 5_400_000.1, 0.0], np.float32))
    decode_npz(far, note=heard.append)
    (remark,) = heard
    assert remark.code == "rounded_origin"
    assert remark.numbers["float32_step_m"] == 0.5
    assert "5,400,000 m from zero" in remark.text
    assert "up to 0.25 m off" in remark.text
    # No remark where nothing is lost: near zero, and in files of version 2.
    decode_npz(members(origin=np.array([10.1, 0.0, 0.0], np.float32)), note=heard.append)
    decode_npz(members(voxjax_map=np.int32(2), origin=np.array([0.0, 5.4e6, 0.0])), note=heard.append)
    assert len(heard) == 1
    (tmp_path / "far.npz").write_bytes(far)
    # That float64 keeps the rounded place would say the contrary.
    assert [remark.code for remark in load_map(tmp_path / "far.npz").remarks] == ["rounded_origin"]
    assert [remark.code for remark in describe_map(tmp_path / "far.npz").remarks] == ["rounded_origin"]
