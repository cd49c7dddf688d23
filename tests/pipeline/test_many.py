"""Merging of many maps: which are merged, and where each ends up."""

import itertools

import numpy as np
import pytest

from fake_register import WORLD, FakeRegister, assert_is, cube_map, fake_features, relative
from voxjax import InputError, VoxelGrid, merge
from voxjax.fusion import rules
from voxjax.pipeline import many


@pytest.fixture
def maps():
    return [cube_map(n) for n in range(5)]


def _merge(monkeypatch, maps, **tables):
    fake = FakeRegister(maps, WORLD, **tables).install(monkeypatch)
    return merge(maps), fake


def test_all_poses_map_into_the_frame_of_the_first_map(monkeypatch, maps):
    merged, _ = _merge(monkeypatch, maps)
    assert merged.status == "merged"
    for number, found in enumerate(merged.poses):
        assert_is(found, relative(0, number))
    assert [(a, b) for a, b, _ in merged.pairs] == list(itertools.combinations(range(5), 2))
    assert merged.grid is not None
    assert merged.grid.num_occupied >= max(m.num_occupied for m in maps)


def test_a_rule_that_is_not_known_is_refused_before_any_pair(monkeypatch, maps):
    fake = FakeRegister(maps, WORLD).install(monkeypatch)
    monkeypatch.setattr(rules, "RULES", ("keep", "log_odds"))  # annotations would refuse other names first
    with pytest.raises(InputError, match="rule"):
        merge(maps, rule="paper")
    assert not fake.calls


def test_a_stranger_is_left_out_and_named(monkeypatch, maps):
    strange = {pair: "no_overlap" for pair in itertools.combinations(range(5), 2) if 3 in pair}
    merged, _ = _merge(monkeypatch, maps, verdicts=strange)
    assert merged.status == "partial"
    assert [n for n, found in enumerate(merged.poses) if found is None] == [3]
    assert "left out: 3" in merged.reason


@pytest.mark.parametrize("verdict", ["no_overlap", "ambiguous"])
def test_nothing_accepted_gives_no_map_but_the_hypotheses(monkeypatch, maps, verdict):
    merged, _ = _merge(
        monkeypatch, maps, verdicts=dict.fromkeys(itertools.combinations(range(5), 2), verdict)
    )
    assert merged.status == "no_overlap"
    assert merged.grid is None
    assert all(found is None for found in merged.poses)
    assert all(len(r.hypotheses) == 1 for _, _, r in merged.pairs)
    assert verdict in merged.reason


def test_the_largest_part_is_merged_and_its_lowest_map_is_the_world(monkeypatch, maps):
    refused = {
        pair: "no_overlap" for pair in itertools.combinations(range(5), 2) if len({0, 1} & set(pair)) == 1
    }
    merged, _ = _merge(monkeypatch, maps, verdicts=refused)
    assert [found is None for found in merged.poses] == [True, True, False, False, False]
    assert_is(merged.poses[4], relative(2, 4))


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_options_reach_every_pair_and_stages_are_named(monkeypatch, maps, preset):
    fake = FakeRegister(maps, WORLD).install(monkeypatch)
    stages = []
    settings = {"source": {"descriptors": False}}
    merge(maps[:3], preset=preset, gravity_aligned=True, config=settings, on_stage=stages.append)
    assert all(call["gravity_aligned"] and not call["config"].source.descriptors for call in fake.calls)
    assert all(call.get("preset", "default") == preset for call in fake.calls)
    features = ["features of 3 maps"] if preset == "default" else []
    pairs = [f"maps {a} and {b}: hypotheses" for a, b in ((0, 1), (0, 2), (1, 2))]
    assert stages == [*features, *pairs, "fuse"]


def test_features_are_computed_once_a_map(monkeypatch, maps):
    FakeRegister(maps, WORLD).install(monkeypatch)
    prepared = []

    def features_at(grid, *, voxel_size, config):
        prepared.append(voxel_size)
        return fake_features(grid, voxel_size=voxel_size, config=config)

    monkeypatch.setattr(many, "features_at", features_at)
    merge(maps)
    assert prepared == [0.5] * len(maps)


def test_a_map_with_nothing_occupied_is_left_out(monkeypatch, maps):
    empty = VoxelGrid(np.ones((4, 4, 4), np.uint8), np.zeros(3, np.float32), 0.5)
    known = [*maps[:2], empty]
    refused = {(0, 2): "no_overlap", (1, 2): "no_overlap"}
    FakeRegister(known, WORLD, verdicts=refused).install(monkeypatch)
    merged = merge(known)
    assert merged.status == "partial"
    assert merged.poses[2] is None


def test_too_few_maps_and_misplaced_guesses_are_refused(maps):
    with pytest.raises(InputError, match="at least two maps, got 1"):
        merge(maps[:1])
    with pytest.raises(InputError, match="exactly two maps, got 3"):
        merge(maps[:3], init_guess=np.eye(4))
