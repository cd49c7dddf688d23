"""OctoMap files: against the definition of the format, and against OctoMap itself."""

import os
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import octree as oracle
from voxjax import InputError, VoxelGrid
from voxjax.io.octomap import LOG_ODDS_FREE, LOG_ODDS_OCCUPIED, decode_bt, decode_ot, encode_bt, encode_ot
from voxjax.ops.blocks.block_builder import BlockBuilder

SIZE = 0.1


def body(data: bytes) -> bytes:
    return data[data.index(b"\ndata\n") + 6 :]


def make_grid(seed: int, shape=(9, 7, 6), low=(-5, 3, -2), *, with_log_odds=False) -> VoxelGrid:
    """Random blocks, so that some leaves can be pruned and some cannot."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 3, (5, 5, 5)).astype(np.uint8)
    states = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)[: shape[0], : shape[1], : shape[2]].copy()
    flips = rng.random(states.shape) < 0.1
    states[flips] = rng.integers(0, 3, flips.sum())
    log_odds = None
    if with_log_odds:
        values = np.round(rng.uniform(0.1, 2.0, states.shape), 0).astype(np.float32) + np.float32(0.25)
        log_odds = np.where(states == 2, values, np.where(states == 1, -values, np.float32(0)))
    return VoxelGrid(states, np.asarray(low) * SIZE, SIZE, log_odds)


def known_voxels(grid: VoxelGrid, values: np.ndarray) -> dict:
    low = np.rint(np.asarray(grid.origin) / grid.voxel_size).astype(int)
    index = np.argwhere(np.asarray(grid.states) != 0)
    return {tuple((i + low).tolist()): values[tuple(i)].item() for i in index}


def octomap_leaves(tree: octomap.OcTree) -> dict:
    leaves = {}
    for it in tree.begin_leafs():
        width = 2 ** (16 - it.getDepth())  # OctoMap's key of a leaf is near its centre, ours its lowest voxel
        key = it.getKey()
        leaves[(*(key[a] // width * width for a in range(3)), it.getDepth())] = it.getValue()
    return leaves


def read_by_octomap(path: Path) -> octomap.OcTree:
    tree = octomap.OcTree(1.0)
    if path.suffix == ".bt":
        assert tree.readBinary(str(path).encode())
        return tree
    return octomap.OcTree.read(str(path).encode())


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_bt_holds_the_pruned_tree_of_the_grid(seed):
    grid = make_grid(seed)
    filled = known_voxels(grid, np.asarray(grid.states))
    leaves = oracle.leaves_of_bt(body(encode_bt(grid)))
    assert leaves == oracle.pruned(filled)
    assert oracle.voxels(leaves) == filled


def test_a_box_of_more_voxels_than_int32_counts_goes_there_and_back():
    far = np.array([[0, 0, 0], [5, 3, 1], [40_000, 900, 300], [40_001, 901, 299]])
    builder = BlockBuilder((40_007, 1001, 310), np.uint8)
    builder.put_boxes(np.array([[100, 20, 7]]), (64, 32, 16), np.array([1], np.uint8))
    for x, y, z in far:
        block = np.zeros((1, 8, 8, 8), np.uint8)
        block[0, x % 8, y % 8, z % 8] = 2
        if (x, y) != (40_001, 901):
            builder.add(np.array([[x // 8, y // 8, z // 8]]), block)
    grid = VoxelGrid(builder.finish(), np.array([-20_003, 17, 5]) * SIZE, SIZE)
    assert grid.num_voxels > 2**31
    expected = grid.crop_to_known()
    tracemalloc.start()
    for encode, decode in ((encode_bt, decode_bt), (encode_ot, decode_ot)):
        back = decode(encode(grid))
        assert back.is_sparse
        assert back.state_blocks().equals(expected.state_blocks())
        np.testing.assert_allclose(back.origin, expected.origin)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A table of the box has 100 MB, of which few pages are written; the dense array would have 12 GB.
    assert peak < 150_000_000


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_ot_holds_the_pruned_tree_of_the_log_odds(seed):
    grid = make_grid(seed, with_log_odds=True)
    leaves = oracle.leaves_of_ot(body(encode_ot(grid)))
    assert leaves == oracle.pruned(known_voxels(grid, np.asarray(grid.log_odds)))


@pytest.mark.parametrize("with_log_odds", [False, True])
def test_there_and_back_is_the_grid_cropped_to_what_is_known(with_log_odds):
    grid = make_grid(3, with_log_odds=with_log_odds)
    expected = grid.crop_to_known()
    if not with_log_odds:
        assert decode_bt(encode_bt(grid)) == expected
    back = decode_ot(encode_ot(grid))
    np.testing.assert_array_equal(back.states, expected.states)
    np.testing.assert_array_equal(back.origin, expected.origin)
    odds = (
        expected.log_odds
        if with_log_odds
        else np.array([0, LOG_ODDS_FREE, LOG_ODDS_OCCUPIED])[expected.states]
    )
    np.testing.assert_array_equal(back.log_odds, odds)


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_octomap_reads_the_same_leaves(tmp_path, ending):
    grid = make_grid(5, (40, 33, 21), (-17, -30, 4), with_log_odds=ending == ".ot")
    data = encode_bt(grid) if ending == ".bt" else encode_ot(grid)
    path = tmp_path / f"map{ending}"
    path.write_bytes(data)
    leaves = octomap_leaves(read_by_octomap(path))
    if ending == ".bt":
        ours = oracle.leaves_of_bt(body(data))
        assert {key: 2 if value > 0 else 1 for key, value in leaves.items()} == ours
    else:
        assert leaves == oracle.leaves_of_ot(body(data))


def test_values_of_binary_leaves_are_octomaps(tmp_path):
    path = tmp_path / "map.bt"
    path.write_bytes(encode_bt(VoxelGrid(np.array([[[1, 2]]], np.uint8), np.zeros(3), SIZE)))
    assert sorted(octomap_leaves(read_by_octomap(path)).values()) == [LOG_ODDS_FREE, LOG_ODDS_OCCUPIED]


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_files_of_octomap_are_read_with_every_voxel_in_place(tmp_path, ending):
    rng = np.random.default_rng(1)
    tree = octomap.OcTree(0.05)
    walls = np.argwhere(np.pad(np.zeros((14, 10, 6), bool), 1, constant_values=True)) * 0.05
    tree.insertPointCloud(walls + rng.uniform(0.001, 0.049, walls.shape) - 0.3, np.array([0.1, 0.0, -0.1]))
    tree.updateInnerOccupancy()
    path = tmp_path / f"map{ending}"
    data = tree.writeBinary() if ending == ".bt" else tree.write()
    path.write_bytes(data)
    grid = decode_bt(data) if ending == ".bt" else decode_ot(data)
    filled = oracle.voxels(octomap_leaves(read_by_octomap(path)))
    values = (
        np.where(grid.states == 2, LOG_ODDS_OCCUPIED, LOG_ODDS_FREE) if ending == ".bt" else grid.log_odds
    )
    assert known_voxels(grid, np.asarray(values)) == filled
    assert grid.num_occupied == sum(value >= 0 for value in filled.values()) > 100
    assert grid.num_free > 100
    # The centre of a voxel is half a voxel from the lattice: OctoMap must find an occupied leaf just there.
    reread = read_by_octomap(path)
    for point in grid.occupied_points()[::50]:
        assert reread.isNodeOccupied(reread.search(point.astype(np.float64)))
    assert (encode_bt if ending == ".bt" else encode_ot)(grid) == data


def test_a_colour_tree_header_over_plain_binary_nodes_is_read():
    grid = make_grid(7)
    assert decode_bt(encode_bt(grid).replace(b"id OcTree", b"id ColorOcTree")) == grid.crop_to_known()


def test_the_header_from_before_version_1_is_read():
    grid = make_grid(8)
    data = encode_bt(grid)
    size = int(data.split(b"size ")[1].split()[0])
    assert decode_bt(struct.pack("<idI", 3, SIZE, size) + body(data)) == grid.crop_to_known()


def test_colours_are_skipped():
    grid = make_grid(9, with_log_odds=True)
    plain = np.frombuffer(body(encode_ot(grid)), np.dtype([("value", "<f4"), ("mask", "u1")]))
    colored = np.zeros(len(plain), np.dtype([("value", "<f4"), ("rgb", "u1", 3), ("mask", "u1")]))
    colored["value"], colored["mask"], colored["rgb"] = plain["value"], plain["mask"], 77
    header = encode_ot(grid)[: -plain.nbytes].replace(b"id OcTree", b"id ColorOcTree")
    assert decode_ot(header + colored.tobytes()) == grid.crop_to_known()


@pytest.mark.parametrize(("encode", "decode"), [(encode_bt, decode_bt), (encode_ot, decode_ot)])
def test_a_map_of_nothing_goes_there_and_back(encode, decode):
    back = decode(encode(VoxelGrid(np.zeros((3, 4, 5), np.uint8), np.zeros(3), SIZE)))
    assert back.shape == (1, 1, 1)
    assert back.num_occupied == back.num_free == 0


@pytest.mark.parametrize("low", [(-32768, 0, 0), (32767, 32767, 32767), (-32768, -32768, 32760)])
def test_voxels_at_the_edge_of_octomaps_range_keep_their_place(low):
    grid = VoxelGrid(np.full((1, 1, 1), 2, np.uint8), np.asarray(low, np.float64) * SIZE, SIZE)
    assert decode_bt(encode_bt(grid)) == grid


def test_a_grid_off_the_lattice_or_out_of_range_is_refused():
    one = np.full((1, 1, 1), 2, np.uint8)
    with pytest.raises(InputError, match="whole multiples of the voxel size"):
        encode_bt(VoxelGrid(one, np.array([0.05, 0, 0]), SIZE))
    with pytest.raises(InputError, match="reach 32768 voxels"):
        encode_bt(VoxelGrid(one, np.array([32768 * SIZE, 0, 0]), SIZE))


def test_log_odds_that_no_ot_file_can_hold_are_refused():
    states = np.array([[[1, 2]]], np.uint8)
    with pytest.raises(InputError, match="contradict"):
        encode_ot(VoxelGrid(states, np.zeros(3), SIZE, np.array([[[0.5, 0.5]]], np.float32)))
    with pytest.raises(InputError, match="finite"):
        encode_ot(VoxelGrid(states, np.zeros(3), SIZE, np.array([[[-0.5, np.nan]]], np.float32)))


def bt_file(words, size, resolution="0.1", first=b"# Octomap OcTree binary file") -> bytes:
    header = first + b"\nid OcTree\nsize %d\nres %s\ndata\n" % (size, resolution.encode())
    return header + struct.pack(f"<{len(words)}H", *words)


def ot_file(nodes, size) -> bytes:
    header = b"# Octomap OcTree file\nid OcTree\nsize %d\nres 0.1\ndata\n" % size
    return header + b"".join(struct.pack("<fB", *node) for node in nodes)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "first line"),
        (b"hello", "first line"),
        (b"# Octomap OcTree binary file\nid OcTree\n", "no line 'data'"),
        (b"# Octomap OcTree binary file\nid OcTree\nres 0.1\ndata\n\x00\x00", "lacks the line 'size'"),
        (b"# Octomap OcTree binary file\nid Banana\nsize 1\nres 0.1\ndata\n\x00\x00", "'Banana'"),
        (b"# Octomap OcTree binary file\nid OcTree\nsize -1\nres 0.1\ndata\n\x00\x00", "whole number"),
        (bt_file([3], 10**20), "whole number"),
        (bt_file([3], 1).replace(b"size 1", b"size " + b"9" * 5000), "whole number"),
        (bt_file([3, 0x5555], 10, "zero"), "must be a number"),
        (bt_file([3, 0x5555], 10, "0"), "resolution"),
        (bt_file([3, 0x5555], 10, "-0.1"), "resolution"),
        (bt_file([3, 0x5555], 10, "nan"), "resolution"),
        (bt_file([3, 3], 3), "truncated"),
        (bt_file([], 1), "truncated"),
        (bt_file([3, 1], 3) + b"\x00", "odd number"),
        (bt_file([3, 1, 1], 3), "trailing"),
        (bt_file([0x5], 0), "trailing"),
        (bt_file([3, 1], 4), "says 4 nodes, but the data hold 3"),
        (bt_file([3, 0], 2), "no children"),
        (bt_file([3] * 16 + [1], 18), "deeper than 16"),
        (bt_file([0xFFFF] * 200, 10), "truncated"),
        (bt_file([0x5555], 9), "65536 x 65536 x 65536 voxels"),
        (bt_file([3, 0x4001], 4), "32768 x 32768 x 32768 voxels"),
    ],
)
def test_unusable_bt_bytes_are_refused_in_one_sentence(data, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        decode_bt(data)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (bt_file([3, 1], 3), "first line"),
        (b"# Octomap OcTree file\nid CountingOcTree\nsize 1\nres 0.1\ndata\n12345", "'CountingOcTree'"),
        (ot_file([(1.0, 1)], 1), "truncated"),
        (ot_file([(1.0, 1), (1.0, 0)], 2)[:-1], "whole number of nodes"),
        (ot_file([(1.0, 1), (1.0, 0), (1.0, 0)], 3), "trailing"),
        (ot_file([(1.0, 1), (1.0, 0)], 5), "says 5 nodes, but the data hold 2"),
        (ot_file([(1.0, 0)], 1), "65536 x 65536 x 65536"),
        (ot_file([(1.0, 1)] * 17 + [(1.0, 0)], 18), "deeper than 16"),
        (ot_file([(float("nan"), 1)] * 16 + [(float("nan"), 0)], 17), "NaN"),
        (ot_file([(1.0, 1)] * 16 + [(float("inf"), 0)], 17), "infinite"),
    ],
)
def test_unusable_ot_bytes_are_refused_in_one_sentence(data, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        decode_ot(data)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("decode", "data"),
    [
        (decode_bt, bt_file([3] * 5 + [2], 7)),
        (decode_ot, ot_file([(1.0, 1)] * 6 + [(1.0, 0)], 7)),
    ],
)
def test_a_small_file_that_expands_to_a_huge_grid_costs_its_table(decode, data):
    decode(data)  # makes tables that are kept
    tracemalloc.start()
    grid = decode(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert grid.shape == (1024, 1024, 1024)
    assert grid.num_occupied == 2**30
    assert peak < 60_000_000


@pytest.mark.parametrize(
    ("decode", "data"),
    [
        (decode_bt, bt_file([3] * 2 + [2], 4)),
        (decode_ot, ot_file([(1.0, 1)] * 3 + [(1.0, 0)], 4)),
    ],
)
def test_a_small_file_whose_table_would_be_huge_is_refused(decode, data):
    with pytest.raises(
        InputError,
        match=r"the map of 8192 x 8192 x 8192 voxels of 0\.1 m \(549,755,813,888 occupied in the file\) needs about "
        r".* GB of memory, and a file of .* bytes may take 0\.537 GB; take voxel_size=",
    ):
        decode(data)


def test_a_resolution_beyond_all_maps_is_one_sentence():
    for resolution in ("1e300", "1e-300"):
        with pytest.raises(InputError, match="the resolution must lie between"):
            decode_bt(bt_file([3] * 15 + [1], 17, resolution))


def test_any_cut_or_flipped_file_gives_a_map_or_one_sentence():
    rng = np.random.default_rng(0)
    for encode, decode in ((encode_bt, decode_bt), (encode_ot, decode_ot)):
        data = encode(make_grid(11))
        for _ in range(150):
            damaged = bytearray(data[: rng.integers(0, len(data) + 1)] if rng.random() < 0.5 else data)
            for position in rng.integers(0, max(len(damaged), 1), 3)[: len(damaged)]:
                damaged[position] = rng.integers(0, 256)
            try:
                grid = decode(bytes(damaged), max_voxels=10**6)
            except InputError:
                continue
            assert grid.num_voxels <= 10**6


@pytest.mark.real_maps
@pytest.mark.skipif("VOXJAX_MAPS" not in os.environ, reason="VOXJAX_MAPS names no folder of maps")
@pytest.mark.parametrize("name", ["geb079.bt", "freiburg1_360.bt"])
def test_real_maps_come_back_byte_for_byte(name):
    data = (Path(os.environ["VOXJAX_MAPS"]) / "real" / name).read_bytes()
    grid = decode_bt(data)
    assert body(encode_bt(grid)) == body(data)
    np.testing.assert_array_equal(decode_ot(encode_ot(grid)).states, grid.states)
    if name == "geb079.bt":
        assert encode_bt(grid) == data
