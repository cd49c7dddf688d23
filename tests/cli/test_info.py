"""`voxjax info`: what a map holds."""

import json

import numpy as np
import pytest

from fake_register import cube_map
from voxjax import VoxelGrid, read_map, write_map
from voxjax.cli.info import _memory
from voxjax.cli.main import main


def test_info_counts_voxels(maps, capsys):
    assert main(["info", "m0.npz", "m1.npz", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)
    grid = read_map("m1.npz")
    assert [entry["path"] for entry in entries] == ["m0.npz", "m1.npz"]
    assert entries[1]["counts"]["occupied"] == grid.num_occupied
    assert sum(entries[1]["counts"].values()) == np.prod(grid.shape)
    assert entries[1]["memory_bytes"] == grid.states.nbytes
    assert main(["info", "m0.npz"]) == 0
    assert f"{cube_map(0).num_occupied:,}" in capsys.readouterr().out


def test_names_that_no_terminal_should_see_are_escaped(maps, capsys):
    names = ["two\nlines.npz", "\x1b[31mred.npz", "\udcff.npz"]
    for name in names:
        write_map(name, cube_map(0))
    assert main(["info", *names]) == 0
    shown = capsys.readouterr().out
    assert all(line.isprintable() for line in shown.splitlines())
    assert [line for line in shown.splitlines() if not line.startswith(" ")] == [
        "two\\nlines.npz",
        "\\x1b[31mred.npz",
        "\\udcff.npz",
    ]
    assert main(["info", "--json", *names]) == 0
    assert [entry["path"] for entry in json.loads(capsys.readouterr().out)] == names
    assert main(["convert", names[0], names[2], "--force"]) == 0
    assert main(["info", "\x1b[31mnowhere.npz"]) == 2
    assert "\\x1b[31mnowhere.npz" in capsys.readouterr().err


@pytest.mark.parametrize("voxel_size", ["1e12", "1e-9", "0.5"])
def test_json_holds_numbers_alone(maps, capsys, voxel_size):
    grid = cube_map(0)
    write_map("far.npz", VoxelGrid(grid.states, np.full(3, -9e11, np.float32), grid.voxel_size))
    code = main(["info", "--json", "far.npz", "m0.npz", "--voxel-size", voxel_size])
    shown = capsys.readouterr()
    if code == 2:
        assert len(shown.err.splitlines()) == 1
    else:
        assert "Infinity" not in shown.out
        assert "NaN" not in shown.out
        assert len(json.loads(shown.out)) == 2


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("m.npz", "4.1 MB as dense arrays, as it is kept, no log-odds"),
        ("m.bt", "0.2 MB in blocks, as it is kept (4.1 MB as dense arrays), no log-odds"),
        ("m.zarr", "kept in its store and read as needed (4.1 MB as dense arrays), no log-odds"),
    ],
)
def test_memory_is_told_as_kept_and_as_dense_arrays(folder, capsys, name, words):
    states = np.zeros((160, 160, 160), np.uint8)
    states[0, :, :] = states[-1, -1, -1] = 2
    write_map(name, VoxelGrid(states, np.zeros(3), 0.1))
    assert main(["info", name]) == 0
    assert words in [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert main(["info", name, "--json"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)
    assert entry["memory_bytes"] == 160**3
    # 400 blocks that hold part of the wall and one with the far voxel, and their entries in the table.
    assert entry["kept_bytes"] == {"m.npz": 160**3, "m.bt": 401 * 516, "m.zarr": None}[name]


def test_blocks_that_were_not_counted_have_no_number():
    entry = {"memory_bytes": 1 << 40, "kept_bytes": None, "kept": "blocks"}
    assert _memory(entry) == "kept in blocks (1,099,511.6 MB as dense arrays)"
