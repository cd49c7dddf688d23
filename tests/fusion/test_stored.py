"""Fusion into a store gives the bits of fusion in memory, and reads stores as it needs them."""

import os

import numpy as np
import pytest
from tests.fusion.test_nearest import RULES, make_grid

import voxjax as vx
from oracles.motions import pose_of, random_pose
from voxjax import InputError, VoxelGrid
from voxjax.fusion import stored
from voxjax.fusion.nearest import plan_fusion
from voxjax.io.zarr_chunks import StoreChunks
from voxjax.io.zarr_writing import MapStore
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


@pytest.mark.parametrize("rule", ["keep", "log_odds"])
def test_two_processes_give_the_bits_of_one_and_of_memory(tmp_path, rule):
    grids = [make_grid(n, (290, 40, 18), with_log_odds=True) for n in range(2)]
    poses = [np.eye(4), random_pose(np.random.default_rng(1), metres=1.0, degrees=3)]
    expected = vx.fuse(grids, poses, rule=rule)
    # One map in memory, which the processes are given, and one in a store, which they open.
    given = [grids[0], *opened(tmp_path, grids[1:])]
    fused = vx.fuse(given, poses, rule=rule, out=tmp_path / "two.zarr", num_processes=2)
    assert_same_bits(fused, expected)
    vx.fuse(given, poses, rule=rule, out=tmp_path / "one.zarr")
    names = [
        sorted(
            p.relative_to(tmp_path / f"{n}.zarr") for p in (tmp_path / f"{n}.zarr").rglob("*") if p.is_file()
        )
        for n in ("one", "two")
    ]
    assert names[0] == names[1]
    assert sum("states" in name.parts and "c" in name.parts for name in names[0]) > 1
    for name in names[0]:
        assert (tmp_path / "one.zarr" / name).read_bytes() == (tmp_path / "two.zarr" / name).read_bytes()


def test_what_fails_in_a_process_is_one_sentence_and_leaves_nothing(tmp_path):
    (grid,) = opened(tmp_path, [make_grid(1, (290, 40, 18))])
    chunk = tmp_path / "0.zarr" / "states" / "c" / "1" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[::-1])
    with pytest.raises(InputError, match=r"the chunk \(4, 0, 0\) of its array 'states' is damaged\.$"):
        vx.fuse([grid], [np.eye(4)], out=tmp_path / "m.zarr", num_processes=2)
    assert os.listdir(tmp_path) == ["0.zarr"]


def test_shares_are_disjoint_and_make_the_whole(tmp_path, monkeypatch):
    grid = make_grid(1, (600, 300, 18))
    plan = plan_fusion([grid], [np.eye(4)], rule="keep", voxel_size=grid.voxel_size)
    assert plan is not None
    written = []
    monkeypatch.setattr(MapStore, "write", lambda self, place, windows: written.append(tuple(place)))
    store = MapStore(tmp_path / "m.zarr", plan.shape)
    for index in range(4):
        stored.write_share(plan, store, index, 4)
    assert sorted(written) == [(x, y, 0) for x in range(3) for y in range(2)]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"num_processes": 2}, "num_processes is for out, got 2 and no out; give out, or leave it at 1"),
        ({"num_processes": 0, "out": "m.zarr"}, "num_processes must be a whole number, 1 or more, got 0"),
    ],
)
def test_processes_are_for_stores_and_at_least_one(tmp_path, monkeypatch, options, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=sentence):
        vx.fuse([make_grid(1)], [np.eye(4)], **options)


def test_processes_without_a_shard_of_their_own_are_not_started(tmp_path, monkeypatch):
    shares = []
    monkeypatch.setattr(stored, "run_in_processes", lambda function, some: shares.extend(some))
    vx.fuse([make_grid(1)], [np.eye(4)], out=tmp_path / "one.zarr", num_processes=3)
    assert shares == []
    vx.fuse([make_grid(1, (290, 40, 18))], [np.eye(4)], out=tmp_path / "two.zarr", num_processes=3)
    assert [share[2:] for share in shares] == [(0, 2), (1, 2)]


def test_memory_is_asked_for_all_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "1.5")
    with pytest.raises(
        InputError, match=r"by 4 processes needs about .* take fewer of these, or check the poses"
    ):
        vx.fuse([make_grid(1)], [np.eye(4)], out=tmp_path / "m.zarr", num_processes=4)
    assert os.listdir(tmp_path) == []
