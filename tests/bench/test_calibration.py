"""Rows of the calibration."""

import dataclasses
import json

import numpy as np
from bench.calibration import judge

from bench import calibration
from small_worlds import draw_map, pose
from voxjax import register


def test_a_row_tells_what_was_said_and_what_is_true():
    T = pose(yaw=20.0, translation=(1.0, 2.0, 0.0))
    a, b = draw_map(), draw_map(T)
    found = register(a, b)
    row = judge(found, np.linalg.inv(T), b)
    assert row["right"]
    assert row["rank"] == 0
    assert row["verdict"] == found.verdict
    assert row["leaders"][0]["right"]
    assert row["leaders"][0]["support"] > 0.0
    assert len(row["tangent"]) == 6
    assert row["metres"] < 0.1
    other = judge(found, None, b)
    assert not other["right"]
    assert other["rank"] is None


def test_evidence_of_a_registration_holds_what_the_fit_needs():
    names = {
        field.name for field in dataclasses.fields(register(draw_map(), draw_map()).hypotheses[0].evidence)
    }
    assert {"support", "shared_area", "contradiction_area"} <= names


def test_the_table_is_the_summary_of_the_kept_rows(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert calibration.main(["--table", "--out", str(out)]) == 2
    assert "there is no file" in capsys.readouterr().err
    row = {
        "name": "cross_1_2",
        "kind": "cross",
        "verdict": "no_overlap",
        "confidence": 0.0,
        "right": False,
        "rank": None,
    }
    out.write_text(json.dumps({"rows": [row]}))
    assert calibration.main(["--table", "--out", str(out)]) == 0
    assert "| different buildings (1) | - | - | 0 | 0 (" in capsys.readouterr().out
