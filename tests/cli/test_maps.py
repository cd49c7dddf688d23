"""What the commands say about the maps that they read."""

import json
from pathlib import Path

import numpy as np
import pytest

from clouds import room_points, write_cloud
from command_line import fake_register, one_line
from fake_register import cube_map
from voxjax import VoxelGrid, read_map, write_map
from voxjax.cli.main import main

ROOM = room_points(0.1)


@pytest.fixture
def cloud(folder):
    """A cloud with a point that is none, an equal one and a stray."""
    points = np.concatenate([[[np.nan, 0, 0], [600, 0, 0]], ROOM, ROOM[:1]])
    write_cloud("c.ply", points)
    return "c.ply"


def test_info_says_what_is_odd_as_text_and_as_json(cloud, capsys):
    assert main(["info", cloud]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    lines = [line.strip() for line in shown.out.splitlines()]
    for words in (
        "1 of 12,603 points are NaN",
        "voxel size estimated: 0.2 m",
        "are equal to others",
        "isolated from",
    ):
        assert sum(words in line for line in lines) == 1
    assert main(["info", "--json", cloud]) == 0
    (entry,) = json.loads(capsys.readouterr().out)
    assert [remark["code"] for remark in entry["remarks"]] == [
        "not_finite",
        "estimated_voxel_size",
        "duplicates",
        "isolated",
    ]
    assert all(remark["text"] + "." in lines for remark in entry["remarks"])
    assert entry["remarks"][3]["num_voxels"] == 1


def test_info_has_nothing_to_say_of_a_good_map(maps, capsys):
    assert main(["info", "--json", maps[0]]) == 0
    assert json.loads(capsys.readouterr().out)[0]["remarks"] == []


def test_other_commands_say_it_on_standard_error(cloud, capsys):
    for command in (["convert", cloud, "o.bt"], ["render", cloud, "-o", "p.png", "--voxel-size", "0.5"]):
        assert main([*command, "--drop-isolated"]) == 0
        lines = capsys.readouterr().err.splitlines()
        assert all(line.startswith("voxjax: c.ply: ") and line.endswith(".") for line in lines)
        assert sum("they were left out" in line for line in lines) == 1
        assert sum("voxel size estimated" in line for line in lines) == ("convert" in command)
    assert read_map("o.bt") == VoxelGrid.from_points(ROOM, voxel_size=0.2).crop_to_known()


def test_what_is_cut_and_refused_is_what_was_asked_for(cloud, capsys):
    assert main(["convert", cloud, "o.npz", "--strict"]) == 2
    assert "c.ply cannot be read: 1 of 12,603 points are NaN or infinite" in one_line(capsys)
    assert main(["convert", cloud, "o.npz", "--crop=-1,-1,-1,1,1,1", "--voxel-size", "0.2"]) == 0
    is_inside = ((ROOM >= -1) & (ROOM < 1)).all(axis=1)
    assert read_map("o.npz") == VoxelGrid.from_points(ROOM[is_inside], voxel_size=0.2)
    assert main(["corners", cloud, "-o", "c.csv", "--crop=-4,-4,-4,4,4,4", "--voxel-size", "0.5"]) == 0
    assert Path("c.csv").exists()


@pytest.mark.parametrize("command", [["merge", "-o", "o.npz", "-q"], ["info"], ["render", "-o", "p.png"]])
def test_one_box_for_maps_in_several_frames_is_said_where_it_leaves_nothing_of_one(maps, capsys, command):
    grid = cube_map(1)
    write_map("utm.npz", grid.placed(shift=(450_000.25, 5_400_000.0, 0.0)))
    assert main([*command, "m0.npz", "utm.npz", "--crop", "0,0,0,2,2,2"]) == 2
    said = one_line(capsys)
    assert (
        "utm.npz cannot be read: the map knows nothing in the crop from (0, 0, 0) to (2, 2, 2) m; it" in said
    )
    assert (
        "it spans (450000.25, 5400000, 0) to (450003.25, 5400003, 3) m; --crop is one box for all maps"
        in said
    )
    assert said.endswith("cut single maps before, with voxjax convert --crop.")
    assert main(["convert", "utm.npz", "o.npz", "--crop", "0,0,0,2,2,2"]) == 2
    assert "one box for all" not in one_line(capsys)


def test_a_box_without_a_surface_is_named(maps, capsys):
    states = np.asarray(cube_map(0).states).copy()
    states[:4] = 1
    write_map("free.npz", VoxelGrid(states, np.zeros(3), 0.5))
    assert main(["merge", "m0.npz", "free.npz", "-o", "o.npz", "-q", "--crop", "0,0,0,2,2,2"]) == 2
    assert "free.npz has no occupied voxel in the box of --crop, which is one for all maps" in one_line(
        capsys
    )


def test_merge_says_it_of_each_map_and_keeps_it_in_the_report(monkeypatch, maps, capsys):
    fake_register(monkeypatch)
    lattice = cube_map(1).occupied_points()
    write_cloud("c.ply", np.concatenate([lattice, lattice[:1], [[np.nan, 0, 0]]]))
    # A cloud has no free space, so that the stand-in does not know it by its voxels.
    number = lambda self, given: 0 if getattr(given, "grid", given).num_free else 1
    monkeypatch.setattr("fake_register.FakeRegister.number", number)
    assert main(["merge", "m0.npz", "c.ply", "-o", "o.npz", "--report", "r.json", "-q"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("voxjax: c.ply: ") for line in lines)
    of_maps = [entry["remarks"] for entry in json.loads(Path("r.json").read_text())["maps"]]
    assert of_maps[0] == []
    assert [remark["code"] for remark in of_maps[1]] == ["not_finite", "estimated_voxel_size", "duplicates"]
    # Each cloud has its own voxel size, and a map keeps what it has.
    assert of_maps[1][1]["voxel_size"] == cube_map(1).voxel_size
