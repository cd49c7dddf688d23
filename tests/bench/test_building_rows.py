"""Rows of pairs of buildings."""

import dataclasses

import numpy as np
from bench.building_rows import building_jobs, judge

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


def test_names_of_jobs_differ_and_say_what_the_pairs_are():
    names = [name for name, _ in building_jobs((2, 3, 4), 1000, cache=None, clouds=True)]
    assert len(set(names)) == len(names) == 2 + 3 + 6
    assert [sum(name.startswith(kind) for name in names) for kind in ("pair_", "hotel_", "cross_")] == [
        2,
        3,
        6,
    ]
    assert all(name.endswith("_cloud") for name in names)
