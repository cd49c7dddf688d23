"""Covariances of poses that were refined together."""

import jax.numpy as jnp
import numpy as np

from oracles.rooms import VOXEL
from voxjax.refinement.problems.joint import joint_problem
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.solve.covariance import PATCH_VOXELS, pose_covariance
from voxjax.refinement.solve.joint_covariance import joint_covariance


def test_of_two_maps_it_is_that_of_the_pair_and_nothing_for_what_is_held(prepared, room):
    problem = joint_problem(prepared, [(0, 1)], np.asarray([True, False]), num_points=1024)
    poses = jnp.asarray(np.stack([np.eye(4), room[2]]), jnp.float32)
    counts = jnp.asarray([float(part.num_points) for part in prepared], jnp.float32)
    scale = jnp.float32(VOXEL)
    found = np.asarray(joint_covariance(problem, poses, scale, counts, jnp.float32(VOXEL)))
    assert not found[0].any()
    pair = pose_problem(*prepared, num_points=1024, both_ways=True)
    expected, _ = pose_covariance(pair, poses[1], scale, jnp.mean(counts, dtype=jnp.float32) / PATCH_VOXELS)
    np.testing.assert_allclose(found[1], found[1].T, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(np.diag(found[1]), np.diag(np.asarray(expected)), rtol=0.05)
