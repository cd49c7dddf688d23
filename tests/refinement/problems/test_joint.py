"""The joint problem of maps costs what its pairs cost."""

import jax
import jax.numpy as jnp
import numpy as np

from oracles.rooms import VOXEL
from refinement_problems import KINDS, LOOP, starts_near
from voxjax.refinement.problems.joint import joint_problem
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.joint_equations import relative_pose

POINTS = 256


def test_the_cost_is_that_of_the_pairs(maps, truth):
    level = Level(jnp.float32(VOXEL), jnp.int32(0))
    options = {"residuals": KINDS["all"], "num_points": 2 * POINTS}
    cost = jax.jit(lambda problem, poses: problem.cost(poses, level))
    joint = joint_problem(maps, LOOP, np.arange(3) == 0, **options)
    pairs = [pose_problem(maps[a], maps[b], both_ways=True, **options) for a, b in LOOP]
    for seed, metres in enumerate((0.0, 0.1, 0.5)):
        near = starts_near(truth, maps, seed, metres=metres, degrees=10 * metres)
        poses = jnp.asarray(np.stack(near), jnp.float32)
        expected = [
            float(cost(pair, relative_pose(poses[a], poses[b])))
            for pair, (a, b) in zip(pairs, LOOP, strict=True)
        ]
        assert min(expected) > 0.01
        np.testing.assert_allclose(cost(joint, poses), sum(expected), rtol=1e-5)
