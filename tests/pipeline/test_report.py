"""The report: fixed keys, plain finite numbers."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import small_worlds
from fake_register import FakeRegister, cube_map, pose
from voxjax import merge
from voxjax.pipeline import report

PAIR_KEYS = {
    "a",
    "b",
    "accepted",
    "reason",
    "T_a_b",
    "confidence",
    "covariance",
    "num_associations",
    "clique_size",
    "occupied_agreement",
    "free_conflict",
    "hypotheses",
    "roll_pitch_yaw_degrees",
    "middle_b",
    "middle_shift",
    "seconds",
}


def _report(monkeypatch, verdict):
    maps = [cube_map(0), cube_map(1)]
    poses = [np.eye(4), pose(0.2, (1.0, 2.0, 0.0))]
    FakeRegister(maps, poses, verdicts={(0, 1): verdict}).install(monkeypatch)
    return report.merge_report(merge(maps), maps, ["a.bt", "b.bt"], seconds={"read": 0.25})


def test_the_report_has_the_agreed_keys(monkeypatch):
    found = json.loads(json.dumps(_report(monkeypatch, "accepted"), allow_nan=False))
    assert set(found) >= {"status", "voxjax", "device", "voxel_size", "maps", "pairs", "seconds"}
    for entry in found["maps"]:
        assert set(entry) == {"path", "T_world_map", "num_occupied", "num_free", "num_corners", "remarks"}
    assert set(found["pairs"][0]) >= PAIR_KEYS
    assert set(found["pairs"][0]["hypotheses"][0]) >= {"T_a_b", "score"}
    assert found["status"] == "merged"
    assert found["seconds"]["read"] == 0.25
    assert found["maps"][1]["num_corners"] == 6
    assert found["pairs"][0]["seconds"] == {"features": 0.5}
    np.testing.assert_allclose(
        found["pairs"][0]["roll_pitch_yaw_degrees"], [0, 0, np.degrees(0.2)], atol=1e-5
    )
    middle = np.asarray(found["pairs"][0]["middle_b"])
    np.testing.assert_allclose(middle, np.mean(cube_map(1).extent, axis=0))
    moved = pose(0.2, (1.0, 2.0, 0.0)) @ [*middle, 1.0]
    np.testing.assert_allclose(found["pairs"][0]["middle_shift"], moved[:3] - middle, atol=1e-5)
    assert "corners" not in found["seconds"]  # of which the pair knows how many there are
    np.testing.assert_allclose(found["maps"][1]["T_world_map"], pose(0.2, (1.0, 2.0, 0.0)), atol=1e-5)


def test_a_refusal_says_why_and_gives_the_best_hypothesis(monkeypatch):
    found = _report(monkeypatch, "ambiguous")
    assert found["status"] == "no_overlap"
    assert found["maps"][0]["T_world_map"] is None
    assert found["pairs"][0]["reason"] == "The verdict is ambiguous."
    assert np.shape(found["pairs"][0]["hypotheses"][0]["T_a_b"]) == (4, 4)


@pytest.mark.parametrize("odd", [float("nan"), np.float32("inf"), jnp.float32(np.nan), [np.nan, 1.0], np.inf])
def test_numbers_that_are_not_finite_become_none(odd):
    text = json.dumps(report.finite({"value": odd}), allow_nan=False)
    assert "null" in text


def test_the_device_is_named():
    assert "cpu" in report.device_name().lower() or "gpu" in report.device_name().lower()


def test_corners_that_no_pair_needed_are_counted_for_the_report():
    maps = [small_worlds.draw_map(), small_worlds.draw_map(small_worlds.pose(yaw=30.0))]
    merged = merge(maps)
    assert merged.pairs[0][2].stats["num_rounds"] == 1
    heard = []
    found = report.merge_report(merged, maps, ["a.bt", "b.bt"], on_stage=heard.append)
    assert min(entry["num_corners"] for entry in found["maps"]) > 10
    assert heard == ["corners of the maps for the report"]
    assert found["seconds"]["corners"] > 0.0
    assert found["seconds"]["total"] == merged.seconds["total"]
