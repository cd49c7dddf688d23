"""Chunks of a store are read as they are asked for, checked, and noticed to be gone."""

import shutil

import numpy as np
import pytest

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.io.zarr_chunks import StoreError
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
