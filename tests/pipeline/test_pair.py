"""`vx.register` from end to end, on a small building."""

import subprocess
import sys

import numpy as np
import pytest

import voxjax as vx
from small_worlds import FURNITURE, OTHER_FURNITURE, OTHER_ROOMS, draw_map, pose
from voxjax.metrics import pose_error
from voxjax.pipeline import pair
from voxjax.pipeline.config import Config
from voxjax.pipeline.features import features_at, working_voxel
from voxjax.pipeline.pair import register_features

T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))


@pytest.fixture(scope="module")
def maps():
    """Two overlapping parts of the building, in two frames; the second robot found one thing moved."""
    moved = (*FURNITURE[:-1], ((0.4, 5.0, 0.0), (1.2, 5.6, 0.7)))
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)))
    b = draw_map(T_MAP_WORLD, furniture=moved, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)))
    return a, b, np.linalg.inv(T_MAP_WORLD)


@pytest.fixture(scope="module")
def registration(maps):
    return vx.register(maps[0], maps[1])


def centroid(grid):
    return grid.occupied_points().mean(axis=0, dtype=np.float64)


def test_the_true_pose_is_accepted(maps, registration):
    error = pose_error(registration.T_a_b, maps[2], centroid(maps[1]))
    assert registration.accepted
    assert registration.confidence > 0.8
    assert error.degrees < 0.6
    assert error.metres < 0.08
    assert np.asarray(registration.T_a_b).dtype == np.float64


def test_hypotheses_are_distinct_and_best_first(registration):
    scores = [h.score for h in registration.hypotheses]
    assert scores == sorted(scores, reverse=True)
    np.testing.assert_array_equal(registration.hypotheses[0].T_a_b, registration.T_a_b)
    assert registration.hypotheses[0].source in {
        "corner",
        "virtual corner",
        "subgraph",
        "descriptor",
        "exhaustive",
    }


def test_covariance_is_a_covariance(registration):
    covariance = np.asarray(registration.covariance, np.float64)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert np.sqrt(np.diag(covariance)).max() < 0.2


def test_stats_name_what_was_tried(registration):
    stats = registration.stats
    assert stats["num_hypotheses"] > 100
    assert stats["num_rounds"] == 1
    assert set(stats["seconds"]) >= {"features", "exhaustive search", "leaders", "verdict"}


def test_chance_is_read_off_the_strengths_of_what_was_tried(registration):
    strengths, standing = np.asarray(registration.stats["tried_strengths"]), registration.stats["verdict"]
    assert len(strengths) > 50
    # The floor is that of the settings, for a pair in which nothing else has any strength.
    is_chance = strengths < 0.7 * standing["strength"]
    assert standing["chance"] >= strengths[is_chance].min()
    assert np.isclose(strengths, standing["chance"]).any() or standing["chance"] in [
        h.score for h in registration.hypotheses
    ]


def test_thorough_asks_all_sources(maps, registration):
    found = vx.register(maps[0], maps[1], config={"source": {"thorough": True}})
    stats = found.stats
    assert stats["num_rounds"] == 2
    assert stats["num_corners_a"] > 0
    assert stats["clique_size"] >= 3
    assert set(stats["seconds"]) >= {"corner frames", "common subgraph", "descriptors"}
    assert pose_error(found.T_a_b, registration.T_a_b, centroid(maps[1])).metres < 0.03


def test_poses_far_from_the_guess_are_left_out(maps):
    guess = pose(yaw=2.0, translation=(0.1, -0.1, 0.05)) @ maps[2]
    near = vx.register(maps[0], maps[1], init_guess=guess, guess_uncertainty=(0.5, 0.2))
    assert near.accepted
    assert all(pose_error(h.T_a_b, guess, centroid(maps[1])).metres < 1.0 for h in near.hypotheses)
    elsewhere = pose(yaw=90.0, translation=(4.0, 0.0, 0.0)) @ maps[2]
    assert not vx.register(maps[0], maps[1], init_guess=elsewhere, guess_uncertainty=(0.5, 0.2)).accepted
    with pytest.raises(vx.InputError, match="init_guess"):
        vx.register(maps[0], maps[1], guess_uncertainty=(0.5, 0.2))
    with pytest.raises(vx.InputError, match="radians"):
        vx.register(maps[0], maps[1], init_guess=guess, guess_uncertainty=(0.5, -1.0))
    # A map without a voxel is an outcome, but no reason to take what cannot be used.
    empty = vx.VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3, np.float32), 0.1)
    with pytest.raises(vx.InputError, match="init_guess"):
        vx.register(empty, maps[1], init_guess=np.zeros((4, 4)))


def test_the_other_way_round_is_the_inverse(maps, registration):
    back = vx.register(maps[1], maps[0])
    error = pose_error(back.T_a_b @ registration.T_a_b, np.eye(4), centroid(maps[1]))
    assert back.accepted
    assert error.degrees < 0.3
    assert error.metres < 0.05


def test_two_runs_give_the_same_bits(maps, registration):
    again = vx.register(maps[0], maps[1])
    np.testing.assert_array_equal(again.T_a_b, registration.T_a_b)
    np.testing.assert_array_equal(again.covariance, registration.covariance)
    assert again.confidence == registration.confidence
    assert [h.score for h in again.hypotheses] == [h.score for h in registration.hypotheses]


def test_identical_maps_give_the_identity(maps):
    found = vx.register(maps[0], maps[0])
    assert found.accepted
    np.testing.assert_allclose(found.T_a_b, np.eye(4), atol=0.01)


def test_different_buildings_are_not_accepted(maps):
    stranger = draw_map(T_MAP_WORLD, rooms=OTHER_ROOMS, furniture=OTHER_FURNITURE)
    found = vx.register(maps[0], stranger)
    assert not found.accepted
    assert found.confidence <= 0.5
    assert found.reason


def test_different_voxel_sizes_are_compared_at_the_coarser(maps):
    fine = draw_map(T_MAP_WORLD, voxel_size=0.1)
    found = vx.register(maps[0], fine)
    error = pose_error(found.T_a_b, maps[2], centroid(fine))
    assert working_voxel([maps[0], fine], Config()).size == maps[0].voxel_size
    assert error.degrees < 1.0
    assert error.metres < 0.15


def test_gravity_aligned_finds_yaw_only():
    T = pose(yaw=120.0, translation=(1.0, 2.0, 0.0))
    b = draw_map(T)
    found = vx.register(draw_map(), b, gravity_aligned=True)
    error = pose_error(found.T_a_b, np.linalg.inv(T), centroid(b))
    assert found.accepted
    assert error.degrees < 0.6
    assert error.metres < 0.08
    assert all(h.T_a_b[2, 2] > 0.97 for h in found.hypotheses)


def test_a_guess_alone_is_refined(maps):
    only_guess = {"source": {"corners": False, "subgraph": False, "descriptors": False, "exhaustive": False}}
    guess = pose(yaw=2.0, translation=(0.1, -0.1, 0.05)) @ maps[2]
    found = vx.register(maps[0], maps[1], init_guess=guess, config=only_guess)
    error = pose_error(found.T_a_b, maps[2], centroid(maps[1]))
    assert found.hypotheses[0].source == "guess"
    assert error.degrees < 0.6
    assert error.metres < 0.08


def test_nothing_proposed_is_an_outcome(maps):
    nothing = {"source": {"corners": False, "subgraph": False, "descriptors": False, "exhaustive": False}}
    found = vx.register(maps[0], maps[1], config=nothing)
    assert found.verdict == "no_overlap"
    assert found.hypotheses == ()


def test_settings_reach_the_stages(maps, registration):
    one = vx.register(maps[0], maps[1], config={"leader": {"num_leaders": 1}})
    assert len(one.hypotheses) == 1 < len(registration.hypotheses)
    strict = vx.register(
        maps[0], maps[1], config={"verdict": {"min_support": 1.0}, "pose": {"num_points": 64}}
    )
    assert strict.verdict == "ambiguous"
    assert not np.array_equal(strict.T_a_b, registration.T_a_b)
    few = vx.register(maps[0], maps[1], config={"source": {"max_rotations": 1, "num_peaks": 3}})
    assert few.stats["num_rotations"] == 1


def test_settings_reach_the_paper_method(maps, monkeypatch):
    taken = {}

    def register_paper(a, b, settings, *, conflict_weight):
        taken.update(settings=settings, conflict_weight=conflict_weight)
        return vx.register(grid_of(np.ones((2, 2, 2), np.uint8)), b)

    monkeypatch.setattr(pair, "register_paper", register_paper)
    tables = {"paper": {"max_nodes": 77}, "evidence": {"conflict_weight": 4.0}}
    vx.register(maps[0], maps[1], preset="paper", config=tables)
    assert taken["settings"].max_nodes == 77
    assert taken["conflict_weight"] == 4.0


def grid_of(states):
    return vx.VoxelGrid(states, np.zeros(3, np.float32), 0.1)


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("case", ["empty", "one voxel", "flat", "line"])
def test_maps_that_hold_no_pose_are_an_outcome(case, preset):
    states = np.ones((12, 12, 12), np.uint8)
    if case == "one voxel":
        states[5, 5, 5] = 2
    if case == "flat":
        states[:, :, 5] = 2
    if case == "line":
        states[:, 5, 5] = 2
    found = vx.register(grid_of(states), grid_of(states), preset=preset)
    assert not found.accepted
    assert found.reason
    if case == "empty" and preset == "default":
        assert found.reason == "Map a has no occupied voxel."
        other = vx.register(grid_of(np.full_like(states, 2)), grid_of(states))
        assert other.reason == "Map b has no occupied voxel."


def test_bad_arguments_are_refused(maps):
    for options in ({"gravity_aligned": True}, {"init_guess": np.eye(4)}, {"guess_uncertainty": (1.0, 0.1)}):
        with pytest.raises(vx.InputError, match="preset 'paper'"):
            vx.register(maps[0], maps[1], preset="paper", **options)  # pyright: ignore[reportArgumentType]
    with pytest.raises(vx.InputError, match="init_guess"):
        vx.register(maps[0], maps[1], init_guess=np.zeros((4, 4)))
    with pytest.raises(vx.InputError, match="same voxel_size"):
        register_features(features_at(maps[0], voxel_size=0.2), features_at(maps[1], voxel_size=0.3))


def test_an_unknown_preset_is_refused_where_types_are_not_checked():
    """In a process of its own: here the type checker of the tests would speak first."""
    code = (
        "import numpy as np, voxjax as vx\n"
        "grid = vx.VoxelGrid(np.full((3, 3, 3), 2, np.uint8), np.zeros(3), 0.1)\n"
        "try:\n    vx.register(grid, grid, preset='fast')\n"
        "except vx.InputError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "preset must be one of 'default', 'paper', got 'fast'."
