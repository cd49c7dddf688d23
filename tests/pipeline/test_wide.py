"""Maps of hundreds of metres, by a setting for which a small building is one."""

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map, pose
from voxjax.metrics import pose_error
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at
from voxjax.pipeline.wide import coarser_features, needed_coarsening

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
