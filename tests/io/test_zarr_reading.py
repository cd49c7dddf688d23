"""Maps in Zarr stores: opened without reading them, read by chunks, and refused where they are none."""

import json
import os
import pickle
import shutil

import numpy as np
import pytest
import zarr
import zarr.codecs
from tests.ops.blocks.boxes import random_boxes

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.io import describe_map, load_map
from voxjax.io.crop import crop_grid
from voxjax.io.zarr_chunks import StoreChunks

SHAPE = (150, 70, 30)


def make_map(*, has_log_odds=False):
    states = random_boxes(SHAPE, seed=4)
    states[0, 0, 0] = states[-1, -1, -1] = 2
    odds = states.astype(np.float32) / 4 if has_log_odds else None
    return VoxelGrid(states, (-3.0, 2.0, 0.5), 0.1, odds)


@pytest.fixture
def path(tmp_path):
    vx.write_map(tmp_path / "m.zarr", make_map(has_log_odds=True))
    return tmp_path / "m.zarr"


@pytest.fixture
def reads(monkeypatch):
    """Chunks in the order in which they are read: the array, and the chunk's place."""
    read, seen = StoreChunks.__call__, []

    def note(self, place):
        seen.append((self._name, place))
        return read(self, place)

    monkeypatch.setattr(StoreChunks, "__call__", note)
    return seen


def old_store(tmp_path):
    """A store as they were written before shards: a file for each chunk, packed by zstd."""
    group = zarr.create_group(
        tmp_path / "old.zarr", attributes={"voxjax_map": 1, "origin": [-3.0, 2.0, 0.5], "voxel_size": 0.1}
    )
    codec = zarr.codecs.ZstdCodec(level=9)
    options = {"chunks": (64,) * 3, "shape": SHAPE, "fill_value": 0, "compressors": codec}
    grid = make_map(has_log_odds=True)
    group.create_array("states", dtype="uint8", **options)[:] = grid.states
    group.create_array("log_odds", dtype="float32", **options)[:] = np.asarray(grid.log_odds)
    return tmp_path / "old.zarr"


def edit(path, **changes):
    """Change what the metadata of a group or of an array say; None removes a key."""
    file = path / "zarr.json"
    content = json.loads(file.read_text())
    for key, value in changes.items():
        target = content["attributes"] if key in ("origin", "voxel_size", "units", "voxjax_map") else content
        if value is None:
            del target[key]
        else:
            target[key] = value
    file.write_text(json.dumps(content))


def test_to_open_a_store_reads_no_chunk_and_a_window_those_that_it_meets(path, reads):
    grid, expected = vx.read_map(path), make_map(has_log_odds=True)
    assert "not counted yet" in repr(grid)
    assert (grid.shape, grid.voxel_size, grid.has_log_odds) == (SHAPE, 0.1, True)
    assert not reads
    low, high = (10, 5, 3), (60, 60, 20)
    np.testing.assert_array_equal(grid.states_in(low, high), expected.states_in(low, high))
    assert reads == [("states", (0, 0, 0))]
    grid.states_in((0, 0, 0), (64, 64, 30))
    assert len(reads) == 1
    np.testing.assert_array_equal(
        grid.log_odds_in((60, 0, 0), (70, 9, 9)), expected.log_odds_in((60, 0, 0), (70, 9, 9))
    )
    assert reads[1:] == [("log_odds", (0, 0, 0)), ("log_odds", (1, 0, 0))]


def test_a_crop_reads_the_chunks_that_it_meets(path, reads):
    crop = ((-2.0, 2.1, 0.6), (3.0, 7.0, 3.0))
    assert vx.read_map(path, crop=crop) == crop_grid(make_map(has_log_odds=True), crop)
    assert sorted(reads) == [("log_odds", (0, 0, 0)), ("states", (0, 0, 0))]
    with pytest.raises(InputError, match=r"m\.zarr cannot be read: the map knows nothing in the crop from"):
        vx.read_map(path, crop=((100.0, 0.0, 0.0), (101.0, 1.0, 1.0)))


def test_figures_of_a_map_come_without_keeping_it_and_without_its_log_odds(path, reads):
    facts = describe_map(path).facts
    expected = make_map()
    assert (facts.shape, facts.num_occupied, facts.num_free) == (
        SHAPE,
        expected.num_occupied,
        expected.num_free,
    )
    assert facts.has_log_odds
    assert {name for name, _ in reads} == {"states"}
    assert load_map(path).grid == make_map(has_log_odds=True)


def test_other_options_of_reading_hold_for_stores_too(path):
    expected = make_map(has_log_odds=True)
    assert vx.read_map(path, voxel_size=0.2) == expected.with_voxel_size(0.2)
    with pytest.raises(InputError, match=r"belong to clouds \(\.ply\), not to \.zarr maps"):
        vx.read_map(path, max_range=3.0)
    with pytest.raises(InputError, match="more than the limit of 1,000"):
        vx.read_map(path, max_voxels=1000)
    assert vx.read_map(path, max_voxels=10**6) == expected


@pytest.mark.parametrize(
    "options",
    [
        {"chunks": (50, 9, 30)},
        {"chunks": SHAPE, "compressors": None},
        {"chunks": (16, 16, 16), "shards": (64, 64, 32)},
        {"chunks": (64, 64, 64), "chunk_key_encoding": {"name": "default", "separator": "."}},
        {"chunks": (64, 64, 64), "chunk_key_encoding": {"name": "v2", "separator": "."}},
        {"chunks": (64, 64, 64), "compressors": zarr.codecs.BloscCodec(), "dimension_names": None},
    ],
    ids=["odd chunks", "one chunk", "shards", "dots", "keys of version 2", "other codec"],
)
def test_stores_that_others_write_are_read(tmp_path, options):
    expected = make_map()
    attributes = {"voxjax_map": 1, "origin": [-3.0, 2.0, 0.5], "voxel_size": 0.1, "made by": "somebody"}
    group = zarr.create_group(tmp_path / "m.zarr", attributes=attributes)
    array = group.create_array("states", shape=SHAPE, dtype="uint8", fill_value=0, **options)
    array[:] = expected.states
    assert vx.read_map(tmp_path / "m.zarr") == expected


def test_stores_of_before_shards_are_read(tmp_path):
    path = old_store(tmp_path)
    assert vx.read_map(path) == make_map(has_log_odds=True)
    (path / "states" / "c" / "0" / "0" / "0").write_bytes(b"x" * 10**6)
    with pytest.raises(InputError, match=r"the chunk \(0, 0, 0\) of its array 'states' is damaged"):
        _ = vx.read_map(path).states


@pytest.mark.parametrize("names", [[None, None, None], ["x", None, "z"]])
def test_axes_may_have_no_names(path, names):
    edit(path / "states", dimension_names=names)
    assert vx.read_map(path) == make_map(has_log_odds=True)


def test_opened_maps_go_to_other_processes(tmp_path, path):
    other = zarr.create_group(
        tmp_path / "o.zarr", attributes={"voxjax_map": 1, "origin": [0, 0, 0], "voxel_size": 1}
    )
    other.create_array("states", shape=SHAPE, chunks=(50, 9, 30), dtype="uint8", fill_value=0)[:] = (
        make_map().states
    )
    for place in (path, tmp_path / "o.zarr"):
        grid = vx.read_map(place)
        grid.states_in((0, 0, 0), (9, 9, 9))
        there = pickle.loads(pickle.dumps(grid))
        assert there.is_stored
        assert there == grid


@pytest.mark.parametrize(
    ("where", "changes", "sentence"),
    [
        ("", {"origin": None}, "the store has no attribute 'origin', so it is no voxjax map"),
        ("", {"voxel_size": None}, "the store has no attribute 'voxel_size', so it is no voxjax map"),
        ("", {"voxjax_map": None}, "the store has no attribute 'voxjax_map', so it is no voxjax map"),
        ("", {"voxjax_map": 2}, "the map has version 2, and this voxjax reads version 1"),
        ("", {"units": "mm"}, "the attribute 'units' must be 'm', got 'mm'"),
        (
            "",
            {"origin": [0.0, 1.0]},
            r"the attribute 'origin' must be three finite numbers \[m\], got \[0.0, 1.0\]",
        ),
        ("", {"origin": [0.0, 1.0, float("nan")]}, "the attribute 'origin' must be three finite numbers"),
        ("", {"origin": [0, 1, 10**400]}, "the attribute 'origin' must be three finite numbers"),
        ("", {"voxel_size": "0.1"}, r"the attribute 'voxel_size' must be a finite number \[m\], got '0.1'"),
        ("", {"voxel_size": -0.1}, "voxel_size must be a finite number above 0"),
        ("", {"zarr_format": 2}, r"zarr\.json is damaged, or of something else than a map"),
        ("", {"node_type": "array"}, r"zarr\.json is damaged, or of something else than a map"),
        (
            "states",
            {"data_type": "int16"},
            "the array 'states' must have type uint8 and 3 axes, got int16 and shape",
        ),
        (
            "log_odds",
            {"data_type": "float64"},
            "the array 'log_odds' must have type float32 and 3 axes, got float64",
        ),
        (
            "log_odds",
            {"shape": [150, 70, 31]},
            r"must have the shape of 'states' \(150, 70, 30\), got \(150, 70, 31\)",
        ),
        (
            "states",
            {"dimension_names": ["z", "y", "x"]},
            "the array 'states' must have the axes x, y, z, got z, y, x",
        ),
        ("states", {"fill_value": 1}, "the array 'states' must have the fill value 0, got 1"),
        ("states", {"shape": [10**7, 10**7, 30]}, "more blocks of 8 x 8 x 8 than 32 bits count"),
        ("states", {"codecs": []}, r"states/zarr\.json is damaged"),
        ("states", {"shape": [-3, 70, 30]}, r"states/zarr\.json is damaged"),
    ],
)
def test_what_is_wrong_with_a_store_is_one_sentence(path, where, changes, sentence):
    edit(path / where, **changes)
    with pytest.raises(InputError, match=rf"m\.zarr cannot be read: .*{sentence}") as caught:
        vx.read_map(path)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_chunks_that_no_memory_holds_are_refused_before_they_are_read(tmp_path, monkeypatch):
    path = old_store(tmp_path)
    grid = {"name": "regular", "configuration": {"chunk_shape": [4096, 4096, 4096]}}
    edit(path / "states", chunk_grid=grid)
    monkeypatch.setenv("VOXJAX_MEMORY", "4")
    with pytest.raises(InputError, match="a chunk of the array 'states' needs about 137 GB"):
        vx.read_map(path)
    edit(path / "states", chunk_grid={"name": "regular", "configuration": {"chunk_shape": [0, 64, 64]}})
    with pytest.raises(InputError, match=r"states/zarr\.json is damaged"):
        vx.read_map(path)
    edit(path / "states", chunk_grid={"name": "regular", "configuration": {"chunk_shape": [1, 1, 1]}})
    edit(path / "states", shape=[2000, 2000, 2000])
    with pytest.raises(InputError, match="has too many chunks of 1 x 1 x 1; write larger ones"):
        vx.read_map(path)


def test_what_is_no_store_is_said(tmp_path, path):
    for name, make, sentence in (
        ("gone", lambda _: None, "No such file or directory"),
        ("file", lambda place: place.write_bytes(b"zip"), "it is a file, and a Zarr store is a folder"),
        ("empty", lambda place: place.mkdir(), r"the folder has no file zarr\.json"),
        ("old", lambda place: zarr.create_group(place, zarr_format=2), "it is a Zarr store of version 2"),
        (
            "garbage",
            lambda place: (place.mkdir(), (place / "zarr.json").write_text("{")),
            r"zarr\.json is damaged",
        ),
        (
            "group",
            lambda place: zarr.create_group(place, zarr_format=3),
            "the store has no attribute 'voxjax_map'",
        ),
        ("pipe", lambda place: (place.mkdir(), os.mkfifo(place / "zarr.json")), "it is a device or a pipe"),
    ):
        place = tmp_path / f"{name}.zarr"
        make(place)
        with pytest.raises(InputError, match=rf"{name}\.zarr cannot be read: {sentence}"):
            vx.read_map(place)
    shutil.rmtree(path / "states")
    with pytest.raises(InputError, match="the store has no array 'states', so it is no voxjax map"):
        vx.read_map(path)
    zarr.open_group(path, mode="a").create_group("states")
    with pytest.raises(InputError, match=r"states/zarr\.json is damaged, or of something else than a map"):
        vx.read_map(path)


def test_a_chunk_that_is_no_file_is_refused(path):
    chunk = path / "states" / "c" / "0" / "0" / "0"
    chunk.unlink()
    os.mkfifo(chunk)
    with pytest.raises(InputError, match=r"m\.zarr cannot be read: states/c/0/0/0 is no file"):
        vx.read_map(path)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("states", b"garbage", r"the chunk \(0, 0, 0\) of its array 'states' is damaged"),
        (
            "states",
            3,
            r"the chunk \(0, 0, 0\) of its array 'states' must hold 0 unknown, 1 free or 2 occupied, got 3",
        ),
        (
            "log_odds",
            np.nan,
            r"the chunk \(0, 0, 0\) of its array 'log_odds' must hold finite numbers, got NaN",
        ),
    ],
)
def test_a_wrong_chunk_is_named_when_it_is_read(path, name, content, sentence):
    if isinstance(content, bytes):
        (path / name / "c" / "0" / "0" / "0").write_bytes(content)
    else:
        zarr.open_array(path / name, mode="a")[5, 5, 5] = content
    grid = vx.read_map(path)
    for read in (
        lambda: (grid.states, grid.log_odds),
        lambda: vx.read_map(path, crop=((-3, 2, 0), (9, 9, 9))),
    ):
        with pytest.raises(InputError, match=rf"^\S*m\.zarr cannot be read: {sentence}.*\.$"):
            read()


def test_a_store_that_was_replaced_or_removed_is_not_taken_for_the_one_that_was_opened(path):
    grid, other = vx.read_map(path), vx.read_map(path)
    grid.states_in((0, 0, 0), (3, 3, 3))
    vx.write_map(path, VoxelGrid(np.full(SHAPE, 2, np.uint8), np.zeros(3), 0.1))
    with pytest.raises(
        InputError, match=r"m\.zarr was replaced or removed after it was opened; read it again"
    ):
        grid.states_in((100, 0, 0), (103, 3, 3))
    shutil.rmtree(path)
    with pytest.raises(InputError, match="read it again"):
        other.states_in((0, 0, 0), (3, 3, 3))
