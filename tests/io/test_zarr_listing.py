"""Files of chunks are those whose names are keys of the array, and what else stands in their way is said."""

import os
from typing import Any

import numpy as np
import pytest
import zarr

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.io.zarr_listing import known_files

KEYS: dict[str, Any] = {
    "c/0/{}/0": {"name": "default", "separator": "/"},
    "c.0.{}.0": {"name": "default", "separator": "."},
    "0/{}/0": {"name": "v2", "separator": "/"},
    "0.{}.0": {"name": "v2", "separator": "."},
}


@pytest.fixture
def path(tmp_path):
    """A map of four shards along y."""
    states = np.zeros((30, 800, 8), np.uint8)
    states[:, ::50, 4] = 2
    vx.write_map(tmp_path / "m.zarr", VoxelGrid(states, np.zeros(3), 0.1))
    return tmp_path / "m.zarr"


@pytest.mark.parametrize("own", KEYS)
def test_names_of_another_form_are_no_chunks(tmp_path, own):
    made = zarr.create_array(
        tmp_path / "a", shape=(2, 12, 2), chunks=(2, 1, 2), dtype="uint8", chunk_key_encoding=KEYS[own]
    )
    folder = tmp_path / "a"
    made[:, 3] = made[:, 11] = 1
    for number, form in enumerate(KEYS):
        for name in {form.format(number), form.format("07"), form.format("٣"), form.format("12"), "c.0/5.0"}:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(b"")
    known = known_files(folder, (1, 12, 1), made.metadata.encode_chunk_key)
    assert np.flatnonzero(known).tolist() == sorted({list(KEYS).index(own), 3, 11})


def test_a_moved_chunk_is_missing_as_it_is_to_zarr(path):
    here = path / "states"
    (here / "c" / "0" / "0" / "0").rename(here / "c.0.0.0")
    np.testing.assert_array_equal(vx.read_map(path).states, zarr.open_array(here, mode="r")[:])


def put_file(place):
    place.write_bytes(b"x")


@pytest.mark.parametrize(
    ("name", "put", "sentence"),
    [
        ("c", put_file, "states/c: Not a directory"),
        ("c", os.mkfifo, "states/c: Not a directory"),
        ("c", lambda place: place.symlink_to("."), r"states/c holds a zarr\.json, and a folder of chunks"),
        ("c", lambda place: place.symlink_to(".."), r"states/c holds a zarr\.json, and a folder of chunks"),
        ("c", lambda place: place.symlink_to("c"), "states/c: Too many levels of symbolic links"),
        ("c", lambda place: place.symlink_to("gone"), "states/c: No such file or directory"),
        ("c/0", put_file, "states/c/0: Not a directory"),
        ("c/0/0", lambda place: place.symlink_to("../.."), r"states/c/0/0 holds a zarr\.json"),
        ("c/0/1/0", lambda place: place.symlink_to("0"), "states/c/0/1/0: Too many levels of symbolic links"),
        ("c/0/1/0", lambda place: place.mkdir(), "states/c/0/1/0 is no file, and a chunk is one"),
        ("c/0/1/0", lambda place: place.symlink_to("gone"), "states/c/0/1/0 is no file, and a chunk is one"),
        (
            "zarr.json",
            lambda place: place.symlink_to("gone"),
            r"states/zarr\.json: No such file or directory",
        ),
    ],
)
def test_what_is_in_the_way_of_chunks_is_named(path, name, put, sentence):
    place = path / "states" / name
    place.rename(path / "aside")
    put(place)
    with pytest.raises(InputError, match=rf"^\S*m\.zarr cannot be read: {sentence}.*\.$"):
        vx.read_map(path)
