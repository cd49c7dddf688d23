"""Fusion into a store gives the bits of fusion in memory, and reads stores as it needs them."""

import os

import numpy as np
import pytest
from tests.fusion.test_nearest import RULES, make_grid

import voxjax as vx
from oracles.motions import pose_of, random_pose
from voxjax import InputError, VoxelGrid
from voxjax.fusion import stored
from voxjax.io.zarr_chunks import StoreChunks
from voxjax.ops.blocks.chunked_array import ChunkedArray

FAR = np.array([4e5, 5e6, 300.0])


def opened(tmp_path, grids):
    """The same maps, in stores."""
    for number, grid in enumerate(grids):
        vx.write_map(tmp_path / f"{number}.zarr", grid)
    return [vx.read_map(tmp_path / f"{number}.zarr") for number in range(len(grids))]


def assert_same_bits(one, other):
    assert (one.shape, one.voxel_size) == (other.shape, other.voxel_size)
    np.testing.assert_array_equal(one.origin, other.origin)
    np.testing.assert_array_equal(one.states, other.states)
    assert one.has_log_odds == other.has_log_odds
    if one.has_log_odds:
        np.testing.assert_array_equal(one.log_odds.view(np.int32), other.log_odds.view(np.int32))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("kind", ["in memory", "in stores"])
def test_three_maps_in_a_far_frame_give_the_bits_of_fusion_in_memory(tmp_path, monkeypatch, rule, kind):
    monkeypatch.setattr(stored, "_WINDOW", 64)
    rng = np.random.default_rng(3)
    grids = [make_grid(n, (70, 45, 38), frame=FAR, with_log_odds=n != 1) for n in range(3)]
    poses = [
        pose_of(random_pose(rng, metres=1.0, degrees=40)[:3, :3], FAR) @ pose_of(np.eye(3), -FAR)
        for _ in grids
    ]
    expected = vx.fuse(grids, poses, rule=rule)
    given = grids if kind == "in memory" else opened(tmp_path, grids)
    fused = vx.fuse(given, poses, rule=rule, out=tmp_path / "fused.zarr")
    assert isinstance(fused._states, ChunkedArray)
    assert_same_bits(fused, expected)
    assert fused.num_occupied > 100
    # Maps in stores are fused in memory to the same bits, too.
    assert_same_bits(vx.fuse(given, poses, rule=rule), expected)


def test_maps_at_the_same_place_are_added_in_one_order_wherever_they_are(tmp_path):
    grids = [make_grid(n, (40, 25, 18)) for n in range(3)]
    poses = [np.eye(4)] * 3
    expected = vx.fuse(grids, poses, rule="log_odds")
    given = opened(tmp_path, grids)
    assert_same_bits(vx.fuse(given[::-1], poses, rule="log_odds", out=tmp_path / "f.zarr"), expected)


def test_stores_are_read_window_by_window_and_never_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(stored, "_WINDOW", 64)
    states = np.random.default_rng(0).integers(0, 3, (256, 64, 64), np.uint8)
    (store,) = opened(tmp_path, [VoxelGrid(states, np.zeros(3), 0.1)])
    monkeypatch.setattr(ChunkedArray, "blocks", lambda self: pytest.fail("a store was read whole"))
    read, seen = StoreChunks.__call__, []
    monkeypatch.setattr(
        StoreChunks, "__call__", lambda self, place: (seen.append(place), read(self, place))[1]
    )
    pose = np.eye(4)
    pose[0, 3] = 12.8
    fused = vx.fuse([store], [pose], out=tmp_path / "f.zarr")
    np.testing.assert_array_equal(fused.states_in((60, 0, 0), (70, 64, 64)), states[60:70])
    # Each once, and kept for the next window; then the two that are looked at here.
    assert sorted(seen[:4]) == [(x, 0, 0) for x in range(4)]
    assert len(seen) == 6


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"out": "m.npz"}, "out must be the name of a store, ending in .zarr, got 'm.npz'"),
        ({"out": "no/m.zarr"}, "the folder no does not exist"),
        ({"out": "m.zarr", "interpolation": "trilinear"}, 'out is for interpolation="nearest"'),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch, options, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=sentence):
        vx.fuse([make_grid(1)], [np.eye(4)], **options)
    assert os.listdir(tmp_path) == []


def test_maps_that_know_nothing_make_a_store_of_one_unknown_voxel(tmp_path):
    nothing = VoxelGrid(np.zeros((5, 5, 5), np.uint8), np.zeros(3), 0.1)
    fused = vx.fuse([nothing], [np.eye(4)], out=tmp_path / "m.zarr")
    assert fused == vx.fuse([nothing], [np.eye(4)])


def test_too_little_memory_for_a_window_is_said_and_leaves_nothing(tmp_path, monkeypatch):
    grid = make_grid(1)
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    with pytest.raises(InputError, match="written window by window, needs about"):
        vx.fuse([grid], [np.eye(4)], out=tmp_path / "m.zarr")
    assert os.listdir(tmp_path) == []


def test_a_store_may_be_fused_into_its_own_place(tmp_path):
    grids = [make_grid(n) for n in range(2)]
    first, second = opened(tmp_path, grids)
    expected = vx.fuse(grids, [np.eye(4)] * 2)
    fused = vx.fuse([first, second], [np.eye(4)] * 2, out=tmp_path / "0.zarr")
    assert fused == expected
    assert sorted(os.listdir(tmp_path)) == ["0.zarr", "1.zarr"]
