import jax.numpy as jnp
import numpy as np

from compilations import assert_compiles_nothing
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.solve.pose import solve_pose

POINTS = 2048


def test_a_second_start_and_other_scales_compile_nothing(pair):
    problem = pose_problem(*pair[:2], num_points=POINTS)
    scales = np.array([0.2, 0.1], np.float32)
    solve_pose(problem, jnp.asarray(pair[2], jnp.float32), scales)
    with assert_compiles_nothing(solve_pose):
        solve_pose(problem, jnp.eye(4, dtype=jnp.float32), 0.5 * scales)
