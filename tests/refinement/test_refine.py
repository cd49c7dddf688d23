import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import nudged, pose_error, random_pose
from oracles.rooms import VOXEL
from voxjax.refinement.refine import _each, refine
from voxjax.refinement.residuals.known import Prior
from voxjax.refinement.solve.equations import move_about

POINTS = 2048


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


def test_several_starts_have_the_precision_of_the_caller_on_all_cores():
    poses = np.stack([np.eye(4), 2 * np.eye(4)])
    with jax.enable_x64(True):
        (found,) = _each(lambda T: (jnp.asarray(T) / 3,), poses)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, poses / 3, rtol=1e-15)


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
        ({"num_points": 10**12}, "num_points must be at most 10000000, got 1000000000000"),
    ],
)
def test_bad_input_is_one_sentence(pair, changes, word):
    a, b, T, _ = pair
    with pytest.raises(vx.InputError, match=word):
        refine(a, b, **({"T_a_b": T} | changes))


def test_a_belief_that_is_no_pose_is_no_success(pair):
    a, b, T, centroid = pair
    centroid = np.asarray(centroid, np.float32)
    unknown = Prior(np.full((4, 4), np.nan, np.float32), centroid, np.eye(6, dtype=np.float32))
    with pytest.raises(vx.InputError, match=r"terms\[0\]\.T_a_b must hold numbers"):
        refine(a, b, T, num_points=POINTS, terms=[unknown])
    certain = Prior(np.asarray(T, np.float32), centroid, np.full((6, 6), np.inf, np.float32))
    found = refine(a, b, T, num_points=POINTS, terms=[certain])
    assert found.result == vx.RESULTS.not_converged
    np.testing.assert_allclose(found.T_a_b, T, atol=1e-5)


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
