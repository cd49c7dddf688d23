"""Chunks of a store are read as they are asked for, checked, and noticed to be gone."""

import shutil

import numpy as np
import pytest
import zarr
import zarr.codecs

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.io.zarr_chunks import StoreError, file_named
from voxjax.io.zarr_shards import Layout
from voxjax.ops.blocks.chunked_array import ChunkedArray


@pytest.fixture
def path(tmp_path):
    states = np.zeros((300, 70, 30), np.uint8)
    states[70:80, 5, 5] = states[-1] = 2
    vx.write_map(tmp_path / "m.zarr", VoxelGrid(states, np.zeros(3), 0.1))
    return tmp_path / "m.zarr"


def test_chunks_that_a_shard_does_not_hold_are_not_known(path):
    states = vx.read_map(path)._states
    assert isinstance(states, ChunkedArray)
    np.testing.assert_array_equal(np.argwhere(states.known), [(1, 0, 0), (4, 0, 0), (4, 1, 0)])
    assert states._read((4, 1, 0)).shape == (44, 6, 30)


def test_a_damaged_shard_is_said_when_a_chunk_of_it_is_read_and_others_are_read(path):
    shard = path / "states" / "c" / "0" / "0" / "0"
    shard.write_bytes(shard.read_bytes()[:-1])
    grid = vx.read_map(path)
    assert (grid.states_in((299, 0, 0), (300, 70, 30)) == 2).all()
    with pytest.raises(StoreError, match=r"the chunk \(1, 0, 0\) of its array 'states' is damaged\.$"):
        grid.states_in((70, 0, 0), (80, 9, 9))


def test_a_store_that_is_gone_is_noticed(path):
    grid = vx.read_map(path)
    shutil.rmtree(path)
    with pytest.raises(InputError, match="was replaced or removed after it was opened; read it again"):
        grid.states_in((70, 0, 0), (80, 9, 9))


@pytest.mark.parametrize("codec", [zarr.codecs.ZstdCodec(), zarr.codecs.GzipCodec()], ids=["ours", "of zarr"])
def test_a_chunk_that_is_gone_when_it_is_read_is_named_and_not_taken_for_zeros(tmp_path, codec):
    attributes = {"voxjax_map": 1, "origin": [0, 0, 0], "voxel_size": 1}
    group = zarr.create_group(tmp_path / "m.zarr", attributes=attributes)
    options = {"chunks": (4, 4, 4), "dtype": "uint8", "fill_value": 0, "compressors": codec}
    group.create_array("states", shape=(8, 4, 4), **options)[:] = np.uint8(2)
    grid = vx.read_map(tmp_path / "m.zarr")
    file = tmp_path / "m.zarr" / "states" / "c" / "1" / "0" / "0"
    file.write_bytes(b"garbage")
    with pytest.raises(StoreError, match=r"the chunk \(1, 0, 0\) of its array 'states' is damaged\.$"):
        grid.states_at(np.array([[5, 0, 0]]))
    file.unlink()
    with pytest.raises(
        StoreError, match=r"m\.zarr cannot be read: states/c/1/0/0: No such file or directory\.$"
    ):
        grid.states_at(np.array([[5, 0, 0]]))
    file.symlink_to(file.name)
    with pytest.raises(StoreError, match=r"m\.zarr cannot be read: states/c/1/0/0: Too many levels"):
        grid.states_at(np.array([[5, 0, 0]]))
    assert grid.states_at(np.array([[3, 0, 0]])) == 2


def test_a_shard_that_goes_between_listing_and_reading_is_named(path, monkeypatch):
    index = Layout.index

    def removed_first(self, shard):
        (self.folder / self.key(shard)).unlink()
        return index(self, shard)

    monkeypatch.setattr(Layout, "index", removed_first)
    with pytest.raises(
        InputError, match=r"m\.zarr cannot be read: states/c/\d/0/0: No such file or directory\.$"
    ):
        vx.read_map(path)


def test_errors_of_the_system_are_told_from_those_of_codecs_and_from_want_of_memory():
    with pytest.raises(InputError, match=r"^states/c: Permission denied$"), file_named("states/c"):
        raise PermissionError(13, "Permission denied")
    with pytest.raises(MemoryError), file_named("states/c"):
        raise OSError(12, "Cannot allocate memory")
    with pytest.raises(OSError, match="Not a gzipped file"), file_named("states/c"):
        raise OSError("Not a gzipped file")


def test_a_chunk_for_which_the_process_may_not_take_memory_is_named(path, monkeypatch):
    def refused(*_):
        raise MemoryError

    grid = vx.read_map(path)
    monkeypatch.setattr(Layout, "read", refused)
    sentence = (
        r"m\.zarr cannot be read: this process may not take the memory for the chunk \(1, 0, 0\) of its array"
    )
    for read in (lambda: grid.num_occupied, lambda: vx.read_map(path, crop=((7, 0, 0), (8, 1, 1)))):
        with pytest.raises(StoreError, match=sentence):
            read()


def test_a_map_of_a_relative_name_is_read_from_another_working_directory(path, tmp_path, monkeypatch):
    monkeypatch.chdir(path.parent)
    grid, other = vx.read_map("m.zarr"), vx.read_map("m.zarr")
    expected = vx.read_map(path).num_occupied
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert grid.num_occupied == expected
    shutil.rmtree(path)
    with pytest.raises(StoreError, match=r"^m\.zarr was replaced or removed"):
        other.states_at(np.array([[75, 5, 5]]))
