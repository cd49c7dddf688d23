"""Many starts and many pairs: each as by itself, and none spoils another."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import nudged, pose_error
from oracles.rooms import VOXEL
from voxjax.refinement.maps.coarse_to_fine import coarse_factors
from voxjax.refinement.maps.many_starts import solve_starts
from voxjax.refinement.maps.pair import as_dtype, pose_problem
from voxjax.refinement.refine import refine
from voxjax.refinement.residuals.terms import Term
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 512


class AtLevel(Term):
    """A pull to a place along x that depends on the number of the level."""

    def rows(self, T_a_b, level):
        """See `Term`."""
        goal = jnp.stack(
            [level.number.astype(T_a_b.dtype), jnp.zeros((), T_a_b.dtype), jnp.ones((), T_a_b.dtype)]
        )
        return ((T_a_b[:3, 3] - goal) / level.scale)[:, None]


SCALES = np.asarray([2.0, 1.0], np.float32) * np.float32(VOXEL)


@pytest.fixture(scope="module")
def starts(room, prepared):
    """Two near ones, one a kilometre away, one of NaN."""
    rng = np.random.default_rng(7)
    near = [nudged(room[2], prepared[1].centroid, rng, metres=0.05, degrees=0.5) for _ in range(2)]
    far = near[0] + np.asarray([[0, 0, 0, 1000.0]] * 3 + [[0, 0, 0, 0]])
    return np.stack([*near, far, np.full((4, 4), np.nan)]).astype(np.float32)


def test_under_vmap_one_failure_leaves_the_others_alone(room, prepared, starts):
    problem = pose_problem(*prepared, num_points=POINTS)
    batch = eqx.filter_jit(jax.vmap(solve_pose, in_axes=(None, 0, None)))
    found = batch(problem, jnp.asarray(starts), SCALES)
    for k in (0, 1):
        alone = solve_pose(problem, jnp.asarray(starts[k]), SCALES)
        angle, gap = pose_error(found.T_a_b[k], alone.T_a_b, prepared[1].centroid)
        assert angle < 0.05
        assert gap < 0.05 * VOXEL
        assert bool(found.converged[k])
    np.testing.assert_array_equal(found.T_a_b[2], starts[2])
    assert np.isnan(found.T_a_b[3]).any()


def test_pairs_of_maps_under_vmap(prepared, room, small):
    forth = small(pose_problem(*prepared, num_points=POINTS))
    back = small(pose_problem(*prepared[::-1], num_points=POINTS))
    rng = np.random.default_rng(8)
    start = nudged(room[2], prepared[1].centroid, rng, metres=0.05, degrees=0.5)
    poses = jnp.asarray(np.stack([start, np.linalg.inv(start)]), jnp.float32)
    both = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), forth, back)
    found = eqx.filter_jit(jax.vmap(solve_pose, in_axes=(0, 0, None)))(both, poses, SCALES)
    for k, problem in enumerate((forth, back)):
        alone = solve_pose(problem, poses[k], SCALES)
        angle, gap = pose_error(found.T_a_b[k], alone.T_a_b, problem.centroid)
        assert angle < 0.05
        assert gap < 0.05 * VOXEL


def test_several_starts_end_where_each_ends_alone(prepared, room, starts):
    found = refine(prepared[0], prepared[1], starts[:3], num_points=POINTS)
    assert found.T_a_b.shape == (3, 4, 4)
    assert found.covariance.shape == (3, 6, 6)
    for k in range(2):
        alone = refine(prepared[0], prepared[1], starts[k], num_points=POINTS)
        angle, gap = pose_error(found.T_a_b[k], alone.T_a_b, prepared[1].centroid)
        assert angle < 0.1
        assert gap < 0.1 * VOXEL
        assert found.cost_after[k] <= found.cost_before[k]
    np.testing.assert_allclose(found.T_a_b[2], starts[2])
    is_degenerate = [bool(result) for result in np.asarray(found.result == vx.RESULTS.degenerate)]
    assert is_degenerate == [False, False, True]
    with pytest.raises(vx.InputError, match=r"T_a_b\[1\]"):
        refine(prepared[0], prepared[1], starts[[0, 3]], num_points=POINTS)
    with pytest.raises(vx.InputError, match="at least one"):
        refine(prepared[0], prepared[1], starts[:0], num_points=POINTS)


def test_several_starts_in_float64(prepared, starts):
    with jax.enable_x64(True):
        problem = as_dtype(pose_problem(*prepared, num_points=POINTS), np.float64)
        found = solve_starts(problem, starts[:2].astype(np.float64), SCALES.astype(np.float64))
    assert found.T_a_b.dtype == np.float64
    assert (found.cost_after < found.cost_before).all()


def test_far_starts_are_led_along_coarser_maps(prepared, room):
    start = nudged(room[2], prepared[1].centroid, np.random.default_rng(10), metres=1.0, degrees=12)
    near = pose_error(
        refine(prepared[0], prepared[1], start, num_points=POINTS).T_a_b, room[2], prepared[1].centroid
    )
    led = refine(prepared[0], prepared[1], start, num_points=POINTS, max_distance=1.6)
    error = pose_error(led.T_a_b, room[2], prepared[1].centroid)
    assert error[1] < 0.3 * VOXEL < near[1]
    assert led.cost_after <= led.cost_before


@pytest.mark.parametrize(
    ("voxels", "factors"), [(0.5, []), (4.0, []), (4.1, [2]), (8.0, [2]), (9.0, [4, 2]), (20.0, [8, 4, 2])]
)
def test_coarse_factors_reach_as_far_as_asked(voxels, factors):
    assert coarse_factors(voxels) == factors


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"residuals": {"corners": 1.0}}, "residuals"),
        ({"residuals": {"planes": 0.0}}, "positive"),
        ({"residuals": {}}, "at least one"),
    ],
)
def test_bad_options_are_one_sentence(prepared, room, changes, word):
    with pytest.raises(vx.InputError, match=word):
        refine(prepared[0], prepared[1], room[2], **changes)


@pytest.mark.parametrize("num_levels", [1, 3])
def test_terms_are_told_the_number_of_their_level(num_levels):
    problem = PoseProblem((AtLevel(),), jnp.zeros(3), jnp.asarray(1.0))
    scales = np.geomspace(2.0, 1.0, 3)[-num_levels:].astype(np.float32)
    expected = [num_levels - 1.0, 0.0, 1.0]
    np.testing.assert_allclose(solve_pose(problem, jnp.eye(4), scales).T_a_b[:3, 3], expected, atol=1e-4)
    many = solve_starts(problem, np.stack([np.eye(4, dtype=np.float32)] * 2), scales)
    np.testing.assert_allclose(many.T_a_b[:, :3, 3], [expected] * 2, atol=1e-4)
