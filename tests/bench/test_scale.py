"""The benchmark of maps as they come: far frames, strays, clouds."""

import json

import numpy as np
import pytest
from bench.cases import Case
from bench.scale_sites import apart
from bench.worlds import MapPair

import voxjax as vx
from bench import scale
from small_worlds import draw_map, pose
from voxjax.synthetic import measure_overlap

VOXEL = 0.16


@pytest.fixture(scope="module")
def maps():
    T = pose(yaw=20.0, translation=(1.0, 2.0, 0.0))
    return draw_map(voxel_size=VOXEL), draw_map(T, voxel_size=VOXEL), np.linalg.inv(T)


def test_a_pair_far_out_is_the_pair_near_zero(maps):
    row = scale.frame_row(*maps[:2])
    assert row["verdict near"] == row["verdict far"] == "accepted"
    assert row["gap [mm]"] < 1e-3
    assert row["same states"]


def test_a_stray_lies_where_it_is_said(maps):
    stray = scale.with_stray(maps[0])
    points = stray.occupied_points()
    assert len(points) == maps[0].num_occupied + 1
    assert points[:, 0].max() - maps[0].extent[1][0] == pytest.approx(scale.STRAY, abs=VOXEL)


def test_seconds_and_peak_of_a_process(maps, tmp_path):
    paths = [str(tmp_path / name) for name in ("a.npz", "b.npz")]
    for path, grid in zip(paths, maps, strict=False):
        vx.write_map(path, grid)
    row = scale.measure(*paths)
    assert row["verdict"] == "accepted"
    assert row["seconds"] > 0
    assert row["peak [MB]"] > 50
    json.dumps(row)


def test_clouds_are_judged_at_three_voxel_sizes(maps):
    clouds = [
        vx.VoxelGrid(np.where(m.states == 2, m.states, 0).astype(np.uint8), m.origin, VOXEL) for m in maps[:2]
    ]
    pair = MapPair(clouds[0], clouds[1], maps[2], 1.0)
    case = Case("room", "real", "pair", "yaw", 2.0, 0.3, lambda: pair, {})
    row = scale.cloud_row(case, pair)
    assert [row[f"{name}pose"].partition(",")[0] for name in ("", "own ", "0.1 m ")] == ["right"] * 3
    assert row["voxel [m]"] == VOXEL
    assert row["all [s]"] > row["features [s]"] > 0
    text = scale.table([row])
    assert text.splitlines()[0].startswith("| pair | occupied | pose | voxel [m] |")
    assert len(text.splitlines()) == 3


def test_two_buildings_stand_apart_where_the_pose_says():
    pair = apart(70, 30, 0.4)
    assert pair.T_a_b is not None
    assert measure_overlap(pair.a, pair.b, pair.T_a_b) > 0.4
    # Both buildings are there, far from each other.
    points = pair.a.occupied_points()
    halves = points[:, 0] > points[:, 0].mean()
    assert 0.2 < halves.mean() < 0.8
    assert np.ptp(points[:, 0]) > 130


def test_only_parts_that_are_asked_for_are_run(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scale, "site_cloud_row", lambda seed: {"seed": seed})
    out = tmp_path / "scale.json"
    # The site is too large for a quick run.
    assert scale.main(["--only", "outdoors", "site", "--quick", "--seed", "3", "--out", str(out)]) == 0
    assert json.loads(out.read_text()) == {"outdoors": [{"seed": 3}]}
    assert "\noutdoors\n\n| seed |\n" in capsys.readouterr().out
