"""`voxjax demo`, with maps that are quickly made and a registration that knows the answer."""

import json
from pathlib import Path

import numpy as np
import pytest

from command_line import WORLD, fake_register, files, one_line
from fake_register import cube_map, pose
from voxjax import VoxelGrid, read_map
from voxjax.cli import demo
from voxjax.cli.main import main
from voxjax.synthetic.team import Team


def _with_log_odds(grid):
    """The map with log-odds by which free space outweighs what is occupied."""
    return VoxelGrid(
        grid.states, grid.origin, grid.voxel_size, np.where(grid.states == 2, 0.1, -2.0).astype(np.float32)
    )


def _team(poses):
    """Three maps and where they lie; of their building nothing is known."""
    team = object.__new__(Team)
    object.__setattr__(team, "grids", tuple(_with_log_odds(cube_map(n)) for n in range(3)))
    object.__setattr__(team, "poses", tuple(poses))
    return team


@pytest.fixture
def with_truth(folder, monkeypatch):
    """Lets the demo's maps be ready at once, and their truth be what a test says."""

    def set_truth(poses, **tables):
        monkeypatch.setattr(demo, "simulate_team", lambda seed, *, num_robots, overlap: _team(poses))
        return fake_register(monkeypatch, **tables)

    return set_truth


def test_the_maps_are_merged_compared_and_drawn(with_truth, capsys):
    with_truth(WORLD)
    assert main(["demo", "--out", "d", "-q"]) == 0
    names = ["fused.bt", "picture.png", "report.json", "robot_1.bt", "robot_2.bt", "robot_3.bt"]
    assert sorted(path.name for path in Path("d").iterdir()) == names
    assert read_map("d/fused.bt").num_occupied > 0
    assert [entry["path"] for entry in json.loads(Path("d/report.json").read_text())["maps"]] == [
        f"d/{name}" for name in names[3:]
    ]
    shown = capsys.readouterr().out
    assert "robot_2.bt against the truth: 0.000 m and 0.00 deg" in shown
    assert "6 files in d" in shown
    assert main(["demo", "--out", "d", "-q"]) == 2
    assert one_line(capsys).endswith(
        "exists already; use --force to overwrite it, or another folder with --out."
    )


def test_merging_the_files_gives_the_map_of_the_demo(with_truth):
    with_truth(WORLD)
    assert main(["demo", "--out", "d", "-q"]) == 0
    robots = [f"d/robot_{n}.bt" for n in (1, 2, 3)]
    assert main(["merge", *robots, "-o", "again.bt", "-q"]) == 0
    assert Path("again.bt").read_bytes() == Path("d/fused.bt").read_bytes()


def test_a_wrong_pose_is_a_fault(with_truth, capsys):
    with_truth([WORLD[0], WORLD[1], WORLD[2] @ pose(0.0, (0.5, 0.0, 0.0))])
    assert main(["demo", "--out", "d", "-q"]) == 1
    assert "a pose is off by more than 3.0 deg or 0.4 m" in one_line(capsys)


def test_maps_that_do_not_fit_give_code_3(with_truth, capsys):
    with_truth(WORLD, verdicts={(0, 1): "no_overlap", (1, 2): "no_overlap"})
    assert main(["demo", "--out", "d", "-q"]) == 3
    assert "not all maps were merged" in one_line(capsys)
    assert files() == ["d"]
