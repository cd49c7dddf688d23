"""Rows of the families of places, on small pairs."""

import numpy as np
import pytest
from bench.families import FAMILIES, FamilyPair
from bench.family_rows import Job, family_jobs, family_row, family_table

from bench import family_rows
from small_worlds import draw_map, pose

T_A_B = pose(yaw=40.0, translation=(2.0, 1.0, 0.0))


def small_pair(family, role, seed, *, has_free_space=True):
    """The small building in two frames; two seeds of "elsewhere" are that, too, but without a truth."""
    del seed, has_free_space
    truth = T_A_B if role == "same" else None
    b = draw_map(np.linalg.inv(T_A_B))
    return FamilyPair(draw_map(), b, truth, 0.9 if role == "same" else 0.0, family, role)


def test_a_row_has_the_verdict_what_it_rests_on_and_the_truth(monkeypatch):
    monkeypatch.setattr(family_rows, "family_pair", small_pair)
    row = family_row(Job("room", "same", 0, has_free_space=True))
    assert row["name"] == "room_same_0"
    assert row["verdict"] == "accepted"
    assert row["right"]
    assert row["is_group_right"]
    assert row["evidence"]["strength"] > row["evidence"]["chance"] > 0
    none = family_row(Job("room", "elsewhere", 0, has_free_space=False))
    assert none["name"] == "room_elsewhere_0_cloud"
    assert not none["right"]
    assert none["rank"] is None


def test_jobs_are_all_roles_of_all_families_and_their_names_differ():
    names = [job.name for job in family_jobs(2, 10)]
    assert len(set(names)) == len(names)
    assert {name.split("_")[0] for name in names} == set(FAMILIES)
    assert sum(name.startswith("storeys_storey") for name in names) == 4


def made_up(name, **other):
    return {
        "name": name,
        "kind": "room",
        "role": "same",
        "overlap": 0.5,
        "verdict": "accepted",
        "confidence": 0.9,
        "right": True,
        "reason": "One pose stands out.",
    } | other


def test_the_table_counts_what_was_accepted_rightly_and_wrongly_and_what_was_named():
    wrong = made_up("room_same_1", right=False)
    mirrored = made_up(
        "room_mirrored_0",
        role="mirrored",
        verdict="ambiguous",
        right=False,
        reason="Map b seems to be mirrored: ...",
    )
    scaled = made_up("room_scaled_0", role="scaled", right=False)
    text = "\n".join(family_table([made_up("room_same_0"), wrong, mirrored, scaled]))
    assert "| room | 2, 0.2 to 1 | 1 | 1 / 1 | 1 |" in text
    assert "| mirrored | 1 | 0 | 0 (95.0 %) | 1 |" in text
    assert "| scaled | 1 | 0 | 1 (100.0 %) | 0 |" in text
    assert "Clouds" not in text
    assert "expected calibration error: room 0.650" in text


@pytest.mark.parametrize(
    ("role", "reason", "is_named"),
    [
        ("scaled", "Map b seems to be smaller by 5 %: ...", True),
        ("storey", "... another storey of one plan ...", True),
        ("elsewhere", "No pose stands out.", False),
    ],
)
def test_causes_are_named_in_reasons(role, reason, is_named):
    row = made_up("room_x_0", role=role, reason=reason, verdict="ambiguous", right=False)
    line = next(line for line in "\n".join(family_table([row])).splitlines() if line.startswith(f"| {role} "))
    assert line.endswith(f"| {int(is_named)} |")
