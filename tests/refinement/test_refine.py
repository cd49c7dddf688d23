import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from compilations import assert_compiles_nothing
from oracles.motions import nudged, pose_error, random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.maps.pair import pose_problem
from voxjax.refinement.maps.parts import radius_of, sample_of, surface_of
from voxjax.refinement.maps.views import hard_view
from voxjax.refinement.refine import refine
from voxjax.refinement.residuals.losses import Loss, robust_slope, robustify
from voxjax.refinement.residuals.planes import SLIDE_WEIGHT, PointToPlane, Sample
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.equations import move_about
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 2048


@pytest.fixture(scope="module")
def pair():
    """A room, the same room in another frame, the true pose, and the centroid of the second map."""
    a = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(3), metres=3, degrees=40)
    b = a.transformed(np.linalg.inv(T))
    return prepare_map(a), prepare_map(b), T, b.occupied_points().mean(axis=0)


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


@pytest.mark.parametrize(("metres", "degrees"), [(0.0, 0.0), (0.1, 1.0), (0.2, 3.0), (0.3, 4.0)])
def test_a_nudged_pose_comes_back_to_a_small_part_of_a_voxel(pair, metres, degrees):
    a, b, T, centroid = pair
    start = nudged(T, centroid, np.random.default_rng(int(10 * degrees)), metres=metres, degrees=degrees)
    found = refine(a, b, start, num_points=POINTS)
    error = pose_error(found.T_a_b, T, centroid)
    assert error[0] < 0.3
    assert error[1] < 0.2 * VOXEL
    assert found.cost_after <= found.cost_before
    assert found.result in (vx.RESULTS.successful, vx.RESULTS.not_converged)


@pytest.mark.parametrize("seed", range(5))
def test_refinement_never_raises_the_cost_however_wrong_the_start(pair, seed):
    a, b, T, centroid = pair
    rng = np.random.default_rng(seed)
    start = nudged(T, centroid, rng, metres=rng.uniform(0, 3), degrees=rng.uniform(0, 90))
    found = refine(a, b, start, num_points=POINTS)
    assert found.cost_after <= found.cost_before
    np.testing.assert_allclose(found.T_a_b[:3, :3] @ found.T_a_b[:3, :3].T, np.eye(3), atol=1e-5)


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


def test_maps_without_voxels_are_an_outcome():
    empty = vx.VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3, np.float32), VOXEL)
    found = refine(empty, empty, np.eye(4))
    assert found.result == vx.RESULTS.empty_map
    np.testing.assert_array_equal(found.T_a_b, np.eye(4))


def test_one_voxel_gives_a_finite_pose():
    states = np.zeros((30, 30, 12), np.uint8)
    states[9, 9, 9] = 2
    # Two free corners keep the block of the map, and with it the compiled shapes of the test above.
    states[0, 0, 0] = states[-1, -1, -1] = 1
    grid = vx.VoxelGrid(states, np.zeros(3, np.float32), VOXEL)
    found = refine(grid, grid, np.eye(4), num_points=POINTS)
    assert np.isfinite(found.T_a_b).all()
    assert np.isfinite(found.covariance).all()
    assert found.result == vx.RESULTS.degenerate


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"T_a_b": np.ones((4, 4))}, "T_a_b"),
        ({"max_distance": -1.0}, "max_distance"),
        ({"num_points": 0}, "num_points"),
    ],
)
def test_bad_input_is_one_sentence(pair, changes, word):
    a, b, T, _ = pair
    with pytest.raises(vx.InputError, match=word):
        refine(a, b, **({"T_a_b": T} | changes))


def test_the_tangent_moves_the_centroid_by_its_translation():
    rng = np.random.default_rng(0)
    T = random_pose(rng).astype(np.float32)
    centroid, tangent = (
        rng.normal(size=3).astype(np.float32),
        np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6], np.float32),
    )
    moved = np.asarray(move_about(T, centroid, tangent))
    before, after = T[:3, :3] @ centroid + T[:3, 3], moved[:3, :3] @ centroid + moved[:3, 3]
    np.testing.assert_allclose(after - before, tangent[:3], atol=1e-5)
    assert pose_error(moved, T, centroid)[0] == pytest.approx(
        np.degrees(np.linalg.norm(tangent[3:])), rel=1e-4
    )


@pytest.mark.parametrize("loss", ["geman_mcclure", "cauchy", "huber", "squared"])
def test_losses_follow_their_definition_and_have_a_slope_at_zero(loss):
    lengths = np.array([0.0, 1e-4, 0.3, 0.99, 1.01, 4.0, 50.0], np.float32)
    offsets = lengths[:, None] * np.array([0.6, 0.0, 0.8], np.float32)[None, :]
    x = lengths.astype(np.float64) ** 2
    expected = {
        "geman_mcclure": x / (1 + x),
        "cauchy": np.log1p(x),
        "huber": np.where(x < 1, x, 2 * np.sqrt(x) - 1),
        "squared": x,
    }[loss]
    found = np.sum(np.asarray(robustify(offsets, loss), np.float64) ** 2, axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-9)
    slope = jax.jacfwd(lambda v: robustify(v, loss))(jnp.zeros((1, 3), jnp.float32))
    np.testing.assert_allclose(slope[0, :, 0], np.eye(3), atol=1e-6)
    by_slope = {
        "geman_mcclure": 1 / (1 + x) ** 2,
        "cauchy": 1 / (1 + x),
        "huber": np.where(x < 1, 1, 1 / np.sqrt(np.maximum(x, 1))),
        "squared": np.ones_like(x),
    }[loss]
    np.testing.assert_allclose(robust_slope(jnp.asarray(x, jnp.float32), loss), by_slope, rtol=1e-5)


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


@pytest.mark.parametrize("loss", ["geman_mcclure", "cauchy", "huber", "squared"])
def test_every_loss_brings_a_nudged_pose_back(pair, loss):
    a, b, T, centroid = pair
    start = nudged(T, centroid, np.random.default_rng(3), metres=0.1, degrees=1.0)
    error = pose_error(refine(a, b, start, num_points=POINTS, loss=loss).T_a_b, T, centroid)
    assert error[0] < 0.3
    assert error[1] < 0.2 * VOXEL


def test_the_maps_the_other_way_round_give_the_inverse_pose(pair):
    a, b, T, centroid = pair
    start = nudged(T, centroid, np.random.default_rng(4), metres=0.1, degrees=1.0)
    forth = refine(a, b, start, num_points=POINTS, both_ways=True).T_a_b
    back = refine(b, a, np.linalg.inv(start), num_points=POINTS, both_ways=True).T_a_b
    angle, gap = pose_error(np.linalg.inv(np.asarray(back, np.float64)), forth, centroid)
    # Each keeps the matches that it found last, so they agree to a small part of a voxel only.
    assert angle < 0.1
    assert gap < 0.1 * VOXEL


def test_a_second_start_and_other_scales_compile_nothing(pair):
    problem = pose_problem(*pair[:2], num_points=POINTS)
    scales = np.array([0.2, 0.1], np.float32)
    solve_pose(problem, jnp.asarray(pair[2], jnp.float32), scales)
    with assert_compiles_nothing(solve_pose):
        solve_pose(problem, jnp.eye(4, dtype=jnp.float32), 0.5 * scales)


def test_a_problem_is_a_pytree_of_arrays(pair):
    problem = pose_problem(*pair[:2], num_points=POINTS, both_ways=True)
    assert all(hasattr(leaf, "dtype") for leaf in jax.tree.leaves(problem))
