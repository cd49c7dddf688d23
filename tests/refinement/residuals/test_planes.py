import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.rooms import VOXEL
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.problems.parts import radius_of, sample_of, surface_of
from voxjax.refinement.problems.views import hard_view
from voxjax.refinement.residuals.losses import Loss
from voxjax.refinement.residuals.planes import SLIDE_WEIGHT, PointToPlane, Sample
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 2048


@pytest.fixture(scope="module")
def arrays(pair):
    a, b, T, _ = pair
    return surface_of(hard_view(a), is_signed=True), sample_of(hard_view(b), POINTS), T.astype(np.float32)


def planes_of(surface, sample, loss: Loss = "geman_mcclure"):
    problem = PoseProblem(
        (PointToPlane(surface, sample, np.asarray(SLIDE_WEIGHT, np.float32), loss),),
        sample.centroid,
        radius_of(sample),
    )
    return problem


def level_of(scale):
    return Level(jnp.float32(scale), jnp.int32(0))


def test_residuals_equal_a_search_over_all_voxels(arrays, pair):
    """Brute force over the surface, point by point, away from ties and from the end of the reach."""
    surface, sample, T = arrays
    centres = np.asarray(pair[0].points, np.float64)
    scale = np.float32(0.2)
    points, normals_b, weights = (np.asarray(x)[::16] for x in sample[:3])
    few = Sample(points, normals_b, weights, sample.centroid)
    (residual,) = planes_of(surface, few, "squared").rows(jnp.asarray(T), level_of(scale))
    residual = np.asarray(residual).T
    voxels, normals = np.asarray(surface.points, np.float64), np.asarray(surface.normals, np.float64)
    planarity = np.asarray(surface.planarity)
    cells = np.floor((centres - np.asarray(surface.origin)) / VOXEL)
    checked = 0
    for k, point in enumerate(np.asarray(few.points, np.float64)):
        p = T[:3, :3].astype(np.float64) @ point + T[:3, 3]
        gaps = np.linalg.norm(cells - np.floor((p - np.asarray(surface.origin)) / VOXEL), axis=1)
        best = np.flatnonzero(gaps == gaps.min())
        if len(best) > 1 or gaps.min() > 5:
            continue
        i = int(best[0])
        normal = np.asarray(few.normals[k], np.float64) @ T[:3, :3].T
        cosine = normals[i] @ normal if planarity[i] > 0.3 and normal.any() else 1.0
        if abs(cosine - 0.5) < 0.05:
            continue
        gap = p - voxels[i]
        across = normals[i] * (gap @ normals[i])
        slide = 0.1 * planarity[i] + (1 - planarity[i])
        expected = (across + slide * (gap - across)) / scale * np.sqrt(few.weights[k])
        if cosine < 0.5:
            expected = np.array([5 * VOXEL / scale, 0, 0]) * np.sqrt(few.weights[k])
        np.testing.assert_allclose(residual[k], expected, atol=1e-4)
        checked += 1
    assert checked >= 30


def test_the_other_side_of_a_wall_is_no_match():
    """Two parallel sheets one voxel apart; the nearer one faces away from the point's own normal."""
    states = np.ones((20, 20, 12), np.uint8)
    states[:, :, :6] = 0
    states[:, :, 6] = 2
    below = vx.VoxelGrid(states, np.zeros(3, np.float32), VOXEL)
    above = vx.VoxelGrid(states[:, :, ::-1].copy(), np.zeros(3, np.float32), VOXEL)
    a, b = prepare_map(below), prepare_map(above)
    scale = np.float32(VOXEL)
    shift = np.eye(4, dtype=np.float32)
    shift[2, 3] = VOXEL
    signed, unsigned = (
        planes_of(surface_of(hard_view(a), is_signed=is_signed), sample_of(hard_view(b), POINTS)).cost(
            shift, level_of(scale)
        )
        for is_signed in (True, False)
    )
    assert float(unsigned) < 0.2 < 0.8 < float(signed)
