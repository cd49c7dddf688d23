"""The generated campus: two maps in stores that share a part where the true pose says, mostly unknown."""

import json
import subprocess

import numpy as np
import pytest
from bench.campus_maps import Campus, write_campus

import voxjax as vx
from bench import campus
from voxjax.synthetic import measure_overlap

SMALL = Campus((300, 160, 40), num_buildings=3, num_kinds=1, num_roads=1, voxel_size=0.4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campus")
    truth = write_campus(80, SMALL, folder)
    (folder / "truth.json").write_text(json.dumps(truth.tolist()))
    return folder


def test_both_maps_show_what_they_share_with_noise_of_their_own(folder):
    a, b = (vx.read_map(folder / name) for name in ("a.zarr", "b.zarr"))
    truth = np.asarray(json.loads((folder / "truth.json").read_text()))
    for grid in (a, b):
        assert grid.is_stored
        assert grid.num_free > grid.num_occupied > 1000
        assert grid.num_free + grid.num_occupied < 0.5 * grid.num_voxels
    overlap = measure_overlap(a, b, truth)
    assert 0.2 < overlap < 0.8
    assert measure_overlap(a, b, np.eye(4)) < 0.5 * overlap
    # Building 1 of three is in both, and each map has its own noise of it.
    assert abs(a.num_occupied - b.num_occupied) > 10


def test_a_step_is_measured_and_the_fused_map_is_in_a_store(folder):
    row = campus.measure("fuse 1", folder, "small", 80)
    fused = vx.read_map(folder / "fused.zarr")
    assert row["box"] == list(fused.shape)
    assert row["peak [MB]"] > 50
    assert row["million voxels per second"] > 0
    assert fused.num_occupied > vx.read_map(folder / "a.zarr").num_occupied


def test_what_a_step_in_a_process_says_is_passed_on(tmp_path, monkeypatch):
    def run(command, **options):
        is_fused = "fuse 1" in command
        return subprocess.CompletedProcess(
            command, 0 if is_fused else 2, 'note\n{"seconds": 1.5}\n', "a\nno memory.\n"
        )

    monkeypatch.setattr(subprocess, "run", run)
    assert campus.step_row("fuse 1", tmp_path, "small", 80) == {"seconds": 1.5}
    assert campus.step_row("features", tmp_path, "small", 80) == {"exit code": 2, "says": ["no memory."]}
