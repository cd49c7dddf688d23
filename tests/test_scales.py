"""Maps of any size: with another unit of length a pair gives the same verdict, and the same pose in that unit."""

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map, pose

VOXEL = 0.16
T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))
FACTORS = (0.25, 16.0)
"""Voxels of 4 cm and of 2.56 m: a fragment of a room and a valley of the same shape."""


def scaled(grid, factor):
    return vx.VoxelGrid(
        grid.states, np.asarray(grid.origin) * factor, grid.voxel_size * factor, grid.log_odds
    )


def scaled_pose(T, factor):
    T = np.array(T, np.float64)
    T[:3, 3] *= factor
    return T


@pytest.fixture(scope="module")
def maps():
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)), voxel_size=VOXEL)
    b = draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)), voxel_size=VOXEL)
    return a, b


def check_same_pose(found, expected, factor, point):
    """Poses put a point at one place to a thousandth of a voxel, and turn alike to a thousandth of a degree."""
    apart = (
        found[:3, :3] @ (factor * point)
        + found[:3, 3]
        - factor * (expected[:3, :3] @ point + expected[:3, 3])
    )
    assert np.abs(apart).max() < 1e-3 * VOXEL * factor
    np.testing.assert_allclose(found[:3, :3], expected[:3, :3], rtol=0, atol=2e-5)


@pytest.mark.parametrize("factor", FACTORS)
def test_register_knows_no_unit_of_length(maps, factor):
    def settings(unit):
        # By itself the voxel size is chosen by how fine the maps are, and furniture is as large as in the world.
        return {"map": {"voxel_size": VOXEL * unit}}

    expected = vx.register(*maps, config=settings(1.0))
    found = vx.register(*(scaled(grid, factor) for grid in maps), config=settings(factor))
    assert found.verdict == expected.verdict == "accepted"
    assert found.confidence == pytest.approx(expected.confidence, abs=1e-3)
    assert found.best_score == pytest.approx(expected.best_score, abs=1e-3)
    check_same_pose(
        np.asarray(found.T_a_b), np.asarray(expected.T_a_b), factor, maps[1].occupied_points().mean(axis=0)
    )
    units = np.array([factor] * 3 + [1.0] * 3)
    spread = np.sqrt(np.diag(found.covariance)) / units
    np.testing.assert_allclose(spread, np.sqrt(np.diag(expected.covariance)), rtol=0.02)


@pytest.mark.parametrize("factor", FACTORS)
def test_refine_knows_no_unit_of_length(maps, factor):
    point = maps[1].occupied_points().mean(axis=0)
    start = np.linalg.inv(T_MAP_WORLD) @ pose(yaw=1.0, translation=(0.1, -0.15, 0.1))
    a, b = maps
    expected = vx.refine(a, b, start)
    found = vx.refine(scaled(a, factor), scaled(b, factor), scaled_pose(start, factor))
    check_same_pose(np.asarray(found.T_a_b), np.asarray(expected.T_a_b), factor, point)
