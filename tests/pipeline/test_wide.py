"""Maps of hundreds of metres, by a setting for which a small building is one."""

from itertools import pairwise

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map, pose
from voxjax.maps.prepared import FIELD_RADIUS
from voxjax.metrics import pose_error
from voxjax.pipeline import pair, wide
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at
from voxjax.pipeline.wide import coarser_features, finer_factors, needed_coarsening
from voxjax.registration.judging.leaders import find_leaders

VOXEL = 0.1
T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))
WIDE = {"exhaustive": {"most_cells": 2000}}


@pytest.fixture(scope="module")
def maps():
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)), voxel_size=VOXEL)
    b = draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)), voxel_size=VOXEL)
    return a, b


def test_wide_maps_are_registered_in_coarser_copies_first(maps):
    truth = np.linalg.inv(T_MAP_WORLD)
    found = vx.register(*maps, config=WIDE)
    assert found.stats["coarse_voxel_size"] == pytest.approx(0.2)
    assert found.stats["voxel_size"] == VOXEL
    assert found.stats["seconds"]["coarser features"] > 0
    assert found.verdict == "accepted"
    error = pose_error(np.asarray(found.T_a_b), truth, maps[1].occupied_points().mean(axis=0))
    # What the voxels of the working size tell, and not those of the coarser copies.
    assert error.metres < 0.3 * VOXEL
    assert error.degrees < 0.3
    assert "coarse_voxel_size" not in vx.register(*maps).stats


def test_a_guess_is_tried_in_fine_voxels_too(maps):
    guess = np.linalg.inv(T_MAP_WORLD)
    found = vx.register(
        *maps,
        config=WIDE
        | {"source": {"exhaustive": False, "corners": False, "subgraph": False, "descriptors": False}},
        init_guess=guess,
    )
    assert found.verdict == "accepted"
    assert found.hypotheses[0].source == "guess"


def test_poses_pass_copies_that_refinement_can_step_between(maps):
    assert finer_factors(2) == [1]
    assert finer_factors(FIELD_RADIUS) == [1]
    assert finer_factors(FIELD_RADIUS + 1) == [2, 1]
    for factor in range(2, 200):
        passed = [factor, *finer_factors(factor)]
        assert passed[-1] == 1
        assert all(1 < before / after <= FIELD_RADIUS for before, after in pairwise(passed))


def test_a_pose_from_far_coarser_copies_is_as_good(maps, monkeypatch):
    passed = []
    monkeypatch.setattr(wide, "find_leaders", lambda a, *args: passed.append(a) or find_leaders(a, *args))
    # Poses of these copies are off by more than refinement at the working size could make good in one step.
    monkeypatch.setattr(pair, "needed_coarsening", lambda a, b, settings: 6)
    truth = np.linalg.inv(T_MAP_WORLD)
    silent = dict.fromkeys(("exhaustive", "corners", "subgraph", "descriptors"), False)
    off = np.array(truth)
    off[:3, 3] += (0.5, -0.3, 0.4)
    found = vx.register(*maps, config={"source": silent}, init_guess=off)
    assert found.stats["coarse_voxel_size"] == pytest.approx(6 * VOXEL)
    assert [a.grid.voxel_size for a in passed] == pytest.approx([2 * VOXEL, VOXEL])
    error = pose_error(np.asarray(found.T_a_b), truth, maps[1].occupied_points().mean(axis=0))
    assert error.metres < 0.3 * VOXEL


def test_corners_of_fine_voxels_are_asked_where_copies_are_too_coarse(maps, monkeypatch):
    monkeypatch.setattr(pair, "needed_coarsening", lambda a, b, settings: 8)
    passed = []
    monkeypatch.setattr(wide, "find_leaders", lambda a, *args: passed.append(a) or find_leaders(a, *args))
    found = vx.register(*maps, config={"source": {"exhaustive": False}})
    assert found.stats["coarse_voxel_size"] == pytest.approx(8 * VOXEL)
    assert found.stats["num_rounds"] == 3
    # What they propose passes all copies: a corner alone turns what is far away by too much.
    assert [a.grid.voxel_size for a in passed] == pytest.approx(
        [2 * VOXEL, VOXEL, 8 * VOXEL, 2 * VOXEL, VOXEL]
    )
    assert found.verdict == "accepted"
    error = pose_error(
        np.asarray(found.T_a_b), np.linalg.inv(T_MAP_WORLD), maps[1].occupied_points().mean(axis=0)
    )
    assert error.metres < 0.3 * VOXEL


def test_coarsening_is_the_least_that_is_enough_and_its_features_are_made_once(maps):
    settings = config_from(WIDE)
    a, b = (features_at(grid, voxel_size=VOXEL, config=settings) for grid in maps)
    assert needed_coarsening(a, b, config_from(None)) == 1
    assert needed_coarsening(a, b, settings) == 2
    coarse = coarser_features(a, 2, settings)
    assert coarser_features(a, 2, settings) is coarse
    assert coarse.prepared.grid.voxel_size == 2 * VOXEL
    assert coarse.free_space == a.free_space == "observed"
    np.testing.assert_array_equal(coarse.origin, a.origin)
    low, high = a.prepared.grid.extent
    assert (coarse.prepared.grid.extent[0] >= low - 2 * VOXEL).all()
    assert (coarse.prepared.grid.extent[1] <= high + 2 * VOXEL).all()
