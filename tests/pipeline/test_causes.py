"""Mirrored maps and maps of another scale: named where they are, and nowhere else."""

from functools import partial

import numpy as np
import pytest

import voxjax as vx
from small_worlds import FURNITURE, OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax._results import RESULTS
from voxjax.maps.mirrored import mirrored_grid
from voxjax.registration.causes.similarity import Similarity
from voxjax.registration.hypotheses.proposals import Proposals

T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))
FIRST_ROUND = {"source": {"corners": False, "subgraph": False, "descriptors": False}}


@pytest.fixture(scope="module")
def maps():
    """Two overlapping parts of the building, in two frames."""
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)))
    return a, draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)))


def larger(grid, factor):
    """A map whose lengths are given in a unit that is smaller by so much."""
    return vx.VoxelGrid(grid.states, np.asarray(grid.origin) * factor, grid.voxel_size * factor)


register = partial(vx.register, config=FIRST_ROUND)


def test_a_clean_accepted_pair_is_not_questioned(maps):
    found = register(*maps)
    assert found.accepted
    assert found.result == RESULTS.successful
    assert "handedness" not in found.stats
    # The scale of the best pose alone is looked at.
    assert abs(found.stats["scale"]["scale"] - 1.0) < 0.01
    assert "scaled_score" not in found.stats["scale"]


def test_a_mirrored_map_is_named_with_the_figures(maps):
    found = register(maps[0], mirrored_grid(maps[1]))
    assert found.verdict == "ambiguous"
    assert found.result == RESULTS.mirrored
    assert found.reason.startswith("Map b seems to be mirrored: ")
    assert found.confidence < 0.1
    figures = found.stats["handedness"]
    assert figures["mirrored_score"] > figures["score"]
    assert f"{figures['mirrored_score']:.2f}" in found.reason


@pytest.mark.parametrize("factor", [0.92, 1.06])
def test_a_map_of_another_scale_is_named_with_the_scale(maps, factor):
    found = register(maps[0], larger(maps[1], factor))
    assert found.verdict == "ambiguous"
    assert found.result == RESULTS.scaled
    word = "larger" if factor > 1 else "smaller"
    assert found.reason.startswith(f"Map b seems to be {word} by ")
    # In rooms of a few metres voxels of 15 cm show the scale to a percent or two, which the error says.
    figures = found.stats["scale"]
    assert abs(np.log(figures["scale"] * factor)) < 3.0 * figures["log_error"]
    assert found.confidence < 0.1


def test_different_places_are_neither_mirrored_nor_scaled(maps):
    other = draw_map(T_MAP_WORLD, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)
    found = register(maps[0], other)
    assert not found.accepted
    assert found.result in (RESULTS.no_overlap, RESULTS.ambiguous)
    assert "seems to be" not in found.reason
    # Both were tried, and what was found is told.
    assert found.stats["handedness"]["mirrored_score"] < 0.2
    assert "causes" in found.stats["seconds"]


def test_wide_maps_are_questioned_in_their_coarser_copies():
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)), voxel_size=0.1)
    b = draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)), voxel_size=0.1)
    wide = {**FIRST_ROUND, "exhaustive": {"most_cells": 2000}}
    for changed, result in ((b, RESULTS.successful), (mirrored_grid(b), RESULTS.mirrored)):
        found = register(a, changed, config=wide)
        assert found.stats["coarse_voxel_size"] > 0.1
        assert found.result == result


def test_a_right_pose_with_contradictions_stays_accepted(maps):
    # Things that were moved contradict, and neither the mirror image nor another scale explains them.
    moved = ((0.5, 0.2, 0.0), (2.1, 1.0, 0.8)), *FURNITURE[2:], ((3.0, 2.4, 0.0), (4.1, 3.1, 1.9))
    b = draw_map(T_MAP_WORLD, furniture=moved, seen=((-0.3, -0.3, -0.3), (9.4, 8.4, 3.0)))
    config = {**FIRST_ROUND, "cause": {"max_clean_conflict": 0.003}}
    found = register(maps[0], b, config=config, allow_changes=True)
    assert found.hypotheses[0].evidence.free_conflict > 0.003
    assert found.accepted
    assert "handedness" in found.stats
    assert "scale" in found.stats


def test_an_accepted_pose_is_ambiguous_where_another_scale_explains_as_much(maps, monkeypatch):
    near = Similarity(0.95, np.eye(4, dtype=np.float32), 0.02, 0.5)
    for score, expected in ((1.0, "ambiguous"), (-1.0, "accepted")):
        # A small room seen by few voxels, whose scale its error leaves open.
        monkeypatch.setattr("voxjax.pipeline.causes._similarity_of", lambda *_, best=(near, score): best)
        found = register(*maps)
        assert found.verdict == expected
        assert ("Map b may be larger by 5.3 % (standard error 2.0 %)" in found.reason) == (score > 0.0)
        assert found.stats["scale"] == {"scale": 0.95, "log_error": 0.02}


def test_an_accepted_pose_is_ambiguous_where_map_b_may_have_any_size(maps, monkeypatch):
    near = Similarity(0.2, np.eye(4, dtype=np.float32), 0.1, 0.5)
    monkeypatch.setattr("voxjax.pipeline.causes._similarity_of", lambda *_: (near, -1.0))
    found = register(*maps)
    assert found.verdict == "ambiguous"
    assert found.reason.startswith("What agrees would agree as well if map b had another size")


def test_the_image_of_a_cloud_that_was_accepted_is_looked_for_in_fine_cells(maps, monkeypatch):
    # Of maps that saw no free space nothing speaks against a pose, and coarse cells may miss the image's.
    a, b = (
        vx.VoxelGrid(np.where(grid.states == 2, 2, 0).astype(np.uint8), grid.origin, grid.voxel_size)
        for grid in maps
    )
    nothing = Proposals(np.zeros((0, 4, 4), np.float32), (), 0, {})
    monkeypatch.setattr("voxjax.pipeline.causes.coarse_proposals", lambda *_, **__: nothing)
    monkeypatch.setattr("voxjax.pipeline.pair.coarse_proposals", lambda *_, **__: nothing)
    # These maps are so clean that the accepted pose would not be questioned.
    monkeypatch.setattr("voxjax.pipeline.causes.is_questionable", lambda *_: True)
    found = register(a, b)
    assert found.stats["free_space"] == "inferred"
    assert found.accepted
    assert -1.0 < found.stats["handedness"]["mirrored_score"] < found.stats["handedness"]["score"]
