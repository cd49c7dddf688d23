"""`voxjax corners`: the detected corners as a table."""

from pathlib import Path

import numpy as np

from fake_register import cube_map
from voxjax import VoxelGrid, write_map
from voxjax.cli.main import main


def test_corners_are_listed_with_normals_that_point_into_the_room(folder, capsys):
    states = np.ones((24, 22, 20), np.uint8)
    states[[0, -1]] = states[:, [0, -1]] = states[:, :, [0, -1]] = 2
    write_map("room.npz", VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert main(["corners", "room.npz", "-o", "c.csv", "--virtual"]) == 0
    header, *rows = Path("c.csv").read_text().splitlines()
    assert header == "x,y,z,n1x,n1y,n1z,n2x,n2y,n2z,n3x,n3y,n3z,kind"
    assert len(rows) >= 8
    middle = np.asarray([1.2, 1.1, 1.0])
    for row in rows:
        *numbers, kind = row.split(",")
        numbers = np.asarray(numbers, float)
        assert kind in ("observed", "virtual")
        assert (numbers[3:].reshape(3, 3) @ (middle - numbers[:3]) > 0).all()
    assert f"{sum(row.endswith('observed') for row in rows)} observed" in capsys.readouterr().out


def test_where_no_corner_is_observed_it_is_said_why_and_what_finds_some(folder, capsys):
    states = np.zeros((24, 22, 20), np.uint8)
    states[[0, -1]] = states[:, [0, -1]] = states[:, :, [0, -1]] = 2
    write_map("cloud.npz", VoxelGrid(states, np.zeros(3), 0.1))
    assert main(["corners", "cloud.npz", "-o", "c.csv"]) == 0
    said = capsys.readouterr().out
    assert "c.csv: 0 observed and 0 virtual corners; without free space no corner is observed" in said
    assert "--virtual gives those where its planes meet" in said
    # The advice helps.
    assert main(["corners", "cloud.npz", "-o", "c.csv", "--virtual", "--force"]) == 0
    assert capsys.readouterr().out == "c.csv: 0 observed and 8 virtual corners\n"
    write_map("plain.npz", cube_map(0))
    assert main(["corners", "plain.npz", "-o", "c.csv", "--force"]) == 0
    assert "0 virtual corners; --virtual also gives those where planes meet unseen" in capsys.readouterr().out
