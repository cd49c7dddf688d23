"""Maps as Zarr stores: written whole or not at all, chunk by chunk, and read by anybody."""

import os
import tracemalloc

import numpy as np
import pytest
import zarr
from tests.ops.blocks.boxes import random_boxes

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.io import encode_map, load_map
from voxjax.io.zarr_writing import MapStore
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of
from voxjax.ops.blocks.chunked_array import ChunkedArray

ORIGIN = (449_999.7, 5_400_000.1, 300.3)
"""A far frame whose numbers float32 does not hold."""


def make_map(*, has_log_odds=True, shape=(70, 130, 20)):
    states = random_boxes(shape, seed=4)
    states[:64, 64:128] = 0
    odds = np.where(states == 2, np.float32(0.85), np.float32(-0.4)) * (states > 0)
    return VoxelGrid(states, ORIGIN, 0.1, odds if has_log_odds else None)


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("kind", ["dense", "blocks", "stored"])
@pytest.mark.parametrize("has_log_odds", [False, True])
def test_maps_come_back_from_a_far_frame_to_the_bit(tmp_path, kind, has_log_odds):
    grid = source = make_map(has_log_odds=has_log_odds)
    if kind == "blocks":
        source = VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size, grid.log_odds_blocks())
    if kind == "stored":
        vx.write_map(tmp_path / "first.zarr", grid)
        source = vx.read_map(tmp_path / "first.zarr")
    vx.write_map(tmp_path / "m.zarr", source)
    back = vx.read_map(tmp_path / "m.zarr")
    assert back == grid
    np.testing.assert_array_equal(back.origin, grid.origin)
    assert back.has_log_odds == has_log_odds


def test_any_reader_sees_plain_arrays_with_documented_attributes(tmp_path):
    grid = make_map()
    vx.write_map(tmp_path / "m.zarr", grid)
    group = zarr.open_group(tmp_path / "m.zarr", mode="r")
    assert group.attrs.asdict() == {
        "voxjax_map": 1,
        "origin": list(ORIGIN),
        "voxel_size": 0.1,
        "units": "m",
    }
    for name, values in (("states", grid.states), ("log_odds", np.asarray(grid.log_odds))):
        array = zarr.open_array(tmp_path / "m.zarr" / name, mode="r")
        assert (array.dtype, array.chunks, array.fill_value) == (values.dtype, (64, 64, 64), 0)
        assert array.metadata.to_dict()["dimension_names"] == ("x", "y", "z")
        np.testing.assert_array_equal(array[:], values)
    assert group["states"].attrs["flag_meanings"] == "unknown free occupied"


def test_shards_that_hold_nothing_are_not_stored_and_none_holds_empty_chunks(tmp_path):
    states = np.zeros((600, 70, 30), np.uint8)
    states[1, 69, 3], states[599, 2, 0] = 2, 1
    vx.write_map(tmp_path / "m.zarr", VoxelGrid(states, ORIGIN, 0.1))
    names = files(tmp_path / "m.zarr")
    assert names == ["states/c/0/0/0", "states/c/2/0/0", "states/zarr.json", "zarr.json"]
    back = vx.read_map(tmp_path / "m.zarr")
    assert isinstance(back._states, ChunkedArray)
    np.testing.assert_array_equal(np.argwhere(back._states.known), [(0, 1, 0), (9, 0, 0)])
    # Two chunks of hardly anything, and the indices of 64 chunks.
    sizes = [(tmp_path / "m.zarr" / name).stat().st_size for name in names[:2]]
    assert all(64 * 16 + 4 < size < 64 * 16 + 104 for size in sizes)


def test_zarr_reads_shards_and_this_reads_what_zarr_writes_in_the_same_layout(tmp_path):
    grid = make_map(shape=(300, 70, 20))
    vx.write_map(tmp_path / "m.zarr", grid)
    for name, values in (("states", grid.states), ("log_odds", np.asarray(grid.log_odds))):
        array = zarr.open_array(tmp_path / "m.zarr" / name, mode="a")
        assert (array.chunks, array.shards) == ((64,) * 3, (256,) * 3)
        np.testing.assert_array_equal(array[:], values)
        array[:] = values[::-1]
    back = vx.read_map(tmp_path / "m.zarr")
    np.testing.assert_array_equal(back.states, grid.states[::-1])
    np.testing.assert_array_equal(back.log_odds, np.asarray(grid.log_odds)[::-1])


@pytest.mark.parametrize("shape", [(0, 4, 5), (1, 1, 1)])
def test_maps_of_hardly_anything(tmp_path, shape):
    grid = VoxelGrid(np.zeros(shape, np.uint8), np.zeros(3), 0.2)
    vx.write_map(tmp_path / "m.zarr", grid)
    assert vx.read_map(tmp_path / "m.zarr") == grid
    assert load_map(tmp_path / "m.zarr").grid == grid


def test_a_box_that_no_memory_holds_is_written_and_read_by_its_content(tmp_path):
    builder = BlockBuilder((4_096, 4_096, 256), np.uint8)
    places = np.array([[3, 4, 5], [500, 1, 31], [300, 511, 0]])
    builder.add(places, np.random.default_rng(0).integers(0, 3, (3, 8, 8, 8), np.uint8))
    grid = VoxelGrid(builder.finish(), ORIGIN, 0.1)
    expected = grid.occupied_index()
    tracemalloc.start()
    vx.write_map(tmp_path / "m.zarr", grid)
    back = vx.read_map(tmp_path / "m.zarr")
    index = back.occupied_index()
    window = back.states_in((24, 32, 40), (32, 40, 48))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(index, expected)
    np.testing.assert_array_equal(window, grid.states_in((24, 32, 40), (32, 40, 48)))
    assert len(files(tmp_path / "m.zarr")) == 5
    # The truth values of the table of blocks are 8 MB, and the box is 4.3 GB.
    assert peak < 0.03e9


def test_an_older_store_is_replaced_with_force_and_kept_without(tmp_path):
    path, grid = tmp_path / "m.zarr", make_map()
    vx.write_map(path, VoxelGrid(np.full((100, 1, 1), 2, np.uint8), np.zeros(3), 0.1))
    with pytest.raises(InputError, match=r"m\.zarr exists already"):
        vx.write_map(path, grid, force=False)
    assert vx.read_map(path).shape == (100, 1, 1)
    vx.write_map(path, grid)
    assert vx.read_map(path) == grid
    (tmp_path / "work.zarr").mkdir()
    (tmp_path / "work.zarr" / "thesis.txt").write_text("all of it")
    with pytest.raises(InputError, match=r"is a folder without a file zarr\.json, which is never replaced"):
        vx.write_map(tmp_path / "work.zarr", grid)
    assert files(tmp_path / "work.zarr") == ["thesis.txt"]


@pytest.mark.parametrize("is_there", [False, True])
def test_a_store_that_cannot_be_written_leaves_nothing_and_keeps_the_old(tmp_path, monkeypatch, is_there):
    path, old = tmp_path / "m.zarr", VoxelGrid(np.full((3, 1, 1), 2, np.uint8), np.zeros(3), 0.1)
    if is_there:
        vx.write_map(path, old)
    put, calls = MapStore.put, []

    def fail_at_the_third(self, *args):
        calls.append(args)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        put(self, *args)

    monkeypatch.setattr(MapStore, "put", fail_at_the_third)
    with pytest.raises(InputError, match=r"m\.zarr cannot be written: No space left on device; make room"):
        vx.write_map(path, make_map(shape=(600, 30, 20)))
    assert os.listdir(tmp_path) == (["m.zarr"] if is_there else [])
    assert not is_there or vx.read_map(path) == old


def test_without_the_package_one_sentence_says_what_to_install(tmp_path, monkeypatch):
    vx.write_map(tmp_path / "m.zarr", make_map())
    monkeypatch.setattr("voxjax.io.zarr_reading.find_spec", lambda name: None)
    for call in (lambda: encode_map("m.zarr", make_map()), lambda: vx.read_map(tmp_path / "m.zarr")):
        with pytest.raises(InputError, match=r"need the package zarr, .* pip install 'voxjax\[zarr\]'\.$"):
            call()


def test_shards_may_be_written_in_any_order_and_their_windows_too(tmp_path):
    shape = (300, 70, 20)
    states = random_boxes(shape, seed=2)
    store = MapStore.make(tmp_path / "m.zarr", shape, ORIGIN, 0.1, has_log_odds=False)
    for place, lows in (((1, 0, 0), [256]), ((0, 0, 0), [128, 0, 192, 64])):
        ends = [min(low + 64, 300) for low in lows]
        store.write(
            np.array(place),
            [(np.array([low, 0, 0]), states[low:end], None) for low, end in zip(lows, ends, strict=True)],
        )
    assert vx.read_map(tmp_path / "m.zarr").state_blocks().equals(blocks_of(states))
    vx.write_map(tmp_path / "other.zarr", VoxelGrid(states, ORIGIN, 0.1))
    for name in files(tmp_path / "m.zarr"):
        assert (tmp_path / "m.zarr" / name).read_bytes() == (tmp_path / "other.zarr" / name).read_bytes()
