"""Rows of the families of places, on small pairs."""

import numpy as np
import pytest
from bench.families import FAMILIES, FamilyPair
from bench.family_rows import Job, family_jobs, family_row
from bench.peers import Coarse, Peer

from bench import family_rows, peers
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


def test_the_order_of_jobs_is_the_same_again_and_seeds_come_one_after_another():
    names = [job.name for job in family_jobs(2, 10)]
    assert names == [job.name for job in family_jobs(2, 10)]
    assert all("_10" in name for name in names[: len(names) // 2])


def truthful(points_a, points_b, working):
    """A peer that knows the truth, and thinks it is wrong."""
    assert (len(points_a), len(points_b)) == (
        draw_map().num_occupied,
        draw_map(np.linalg.inv(T_A_B)).num_occupied,
    )
    assert working == pytest.approx(0.3)
    return Coarse(T_A_B, False, 1.0)


def test_peers_answer_for_the_same_pair(monkeypatch):
    monkeypatch.setattr(family_rows, "family_pair", small_pair)
    monkeypatch.setattr(peers, "refine_twice", lambda a, b, T, **other: T)
    earlier = {"name": "room_same_0", "verdict": "as it was", "peers": {"other": {"valid": None}}}
    peer = Peer("theirs", (), "", truthful)
    row = family_row(Job("room", "same", 0, has_free_space=True), [peer], earlier)
    assert row["verdict"] == "as it was"
    assert row["peers"]["other"] == {"valid": None}
    answer = row["peers"]["theirs"]
    assert (answer["valid"], answer["right"]) == (False, True)
    assert answer["metres"] < 1e-6
    assert answer["seconds"] > 0.0
    none = family_row(Job("room", "elsewhere", 0, has_free_space=True), [peer], {"name": "room_elsewhere_0"})
    assert none["peers"]["theirs"]["right"] is False
    assert "metres" not in none["peers"]["theirs"]
