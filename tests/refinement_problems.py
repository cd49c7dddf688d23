"""Small problems of refinement, and starts near the truth, for the tests of its parts."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from oracles.motions import nudged, random_pose
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.residuals.known import CornerPairs
from voxjax.refinement.residuals.losses import Loss
from voxjax.refinement.solve.joint_problem import JointProblem, edges_of
from voxjax.refinement.solve.problem import PoseProblem

KINDS = {
    "planes": {"planes": 1.0},
    "distances": {"distances": 1.0},
    "occupancies": {"occupancies": 1.0},
    "all": {"planes": 1.0, "distances": 0.5, "occupancies": 0.3},
}
"""Weights of residuals: each kind alone, and all together."""

LOOP = [(0, 1), (1, 2), (2, 0)]
"""Pairs of three maps, each with each."""


def one_term(prepared, kind, **options) -> Any:
    return pose_problem(*prepared, residuals={kind: 1.0}, num_points=256, **options).terms[0]


def corner_problem(rng, num_maps, pairs, loss: Loss = "geman_mcclure", more=10):
    """Noisy matched points of maps with known poses in float64; every other pair has `more` points."""
    truth = [random_pose(rng, metres=3, degrees=120) for _ in range(num_maps)]
    centroids = rng.normal(size=(num_maps, 3))
    problems = []
    for number, (a, b) in enumerate(pairs):
        count = 20 + more * (number % 2)
        of_b = centroids[b] + rng.normal(size=(count, 3))
        T_a_b = np.linalg.inv(truth[a]) @ truth[b]
        of_a = of_b @ T_a_b[:3, :3].T + T_a_b[:3, 3] + rng.normal(scale=0.05, size=(count, 3))
        share = jnp.asarray(rng.uniform(0.5, 1.0, count))
        corners = CornerPairs(of_a=jnp.asarray(of_a), of_b=jnp.asarray(of_b), share=share, loss=loss)
        problems.append((a, b, PoseProblem((corners,), jnp.asarray(centroids[b]), jnp.asarray(1.5))))
    is_fixed = jnp.arange(num_maps) == 0
    radii = jnp.asarray(rng.uniform(1.0, 2.0, num_maps))
    return JointProblem(edges_of(problems), jnp.asarray(centroids), radii, is_fixed), np.stack(truth)


def starts_near(truth, maps, seed, *, metres, degrees):
    rng = np.random.default_rng(seed)
    near = [
        nudged(T, each.centroid, rng, metres=metres, degrees=degrees)
        for T, each in zip(truth, maps, strict=True)
    ]
    return [truth[0], *near[1:]]
