import numpy as np

import voxjax as vx
from oracles.rooms import VOXEL
from voxjax.refinement.refine import refine

POINTS = 2048


def test_covariance_is_symmetric_positive_and_smaller_than_a_voxel_here(pair):
    a, b, T, _ = pair
    covariance = np.asarray(refine(a, b, T, num_points=POINTS).covariance)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-3, atol=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert np.sqrt(np.diag(covariance)[:3]).max() < VOXEL


def test_covariance_does_not_depend_on_the_weight_of_the_planes(pair):
    a, b, T, _ = pair
    light, heavy = (refine(a, b, T, num_points=POINTS, residuals={"planes": weight}) for weight in (1.0, 4.0))
    np.testing.assert_allclose(light.covariance, heavy.covariance, rtol=0.02, atol=1e-8)


def test_one_plane_is_degenerate_along_itself():
    states = np.ones((30, 30, 12), np.uint8)
    states[:, :, 0] = 0
    states[:, :, 1] = 2
    grid = vx.VoxelGrid(states, np.zeros(3, np.float32), VOXEL)
    found = refine(grid, grid, np.eye(4), num_points=POINTS)
    assert found.result == vx.RESULTS.degenerate
    sigma = np.sqrt(np.diag(np.asarray(found.covariance)))
    assert sigma[2] < VOXEL < sigma[0]
    assert sigma[2] < VOXEL < sigma[1]
