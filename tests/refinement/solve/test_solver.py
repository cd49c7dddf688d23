"""The solver where the solution is known in closed form."""

import jax.numpy as jnp
import numpy as np

from oracles.motions import nudged
from voxjax.refinement.residuals.known import CornerPairs
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem


def test_corners_alone_give_the_closed_form(room):
    """Matched points: least squares is Kabsch's, whatever the start."""
    rng = np.random.default_rng(5)
    T = np.asarray(room[2])
    of_b = rng.uniform(-2, 2, (12, 3))
    of_a = of_b @ T[:3, :3].T + T[:3, 3] + rng.normal(size=(12, 3)) * 0.02
    centred_a, centred_b = of_a - of_a.mean(axis=0), of_b - of_b.mean(axis=0)
    u, _, vt = np.linalg.svd(centred_a.T @ centred_b)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    shift = of_a.mean(axis=0) - rotation @ of_b.mean(axis=0)
    share = np.full(12, 1 / 12, np.float32)
    pairs = CornerPairs(
        of_a=of_a.astype(np.float32), of_b=of_b.astype(np.float32), share=share, loss="squared"
    )
    problem = PoseProblem((pairs,), of_b.mean(axis=0).astype(np.float32), np.asarray(1.0, np.float32))
    start = nudged(T, of_b.mean(axis=0), rng, metres=0.5, degrees=40).astype(np.float32)
    found = solve_pose(problem, jnp.asarray(start), np.asarray([1.0], np.float32))
    np.testing.assert_allclose(found.T_a_b[:3, :3], rotation, atol=2e-5)
    np.testing.assert_allclose(found.T_a_b[:3, 3], shift, atol=2e-4)
    assert bool(found.converged)
