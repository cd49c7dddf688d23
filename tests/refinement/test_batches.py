"""Many starts and many pairs: each as by itself, and none spoils another."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import nudged, pose_error
from oracles.rooms import VOXEL
from voxjax.refinement.problems.many_starts import solve_starts
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.refine import refine
from voxjax.refinement.residuals.terms import Term
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 512
SCALES = np.asarray([2.0, 1.0], np.float32) * np.float32(VOXEL)


class AtLevel(Term):
    """A pull to a place along x that depends on the number of the level."""

    def rows(self, T_a_b, level):
        """See `Term`."""
        goal = jnp.stack(
            [level.number.astype(T_a_b.dtype), jnp.zeros((), T_a_b.dtype), jnp.ones((), T_a_b.dtype)]
        )
        return ((T_a_b[:3, 3] - goal) / level.scale)[:, None]


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
