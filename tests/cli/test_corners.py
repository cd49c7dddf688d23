"""`voxjax corners`: the detected corners as a table."""

from pathlib import Path

import numpy as np

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
