import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from derivatives import derivatives_at
from refinement_problems import corner_problem
from voxjax.refinement.problems.joint import joint_problem
from voxjax.refinement.solve.joint import solve_joint


def test_many_maps_by_conjugate_gradients_end_where_few_maps_by_factors_do(monkeypatch):
    with jax.enable_x64(True):
        problem, truth = corner_problem(np.random.default_rng(3), 5, [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0)])
        scales = jnp.asarray([0.2])
        found = solve_joint(problem, jnp.asarray(truth), scales)
        monkeypatch.setattr("voxjax.refinement.solve.joint_equations.DENSE_MAPS", 2)
        # Another number of steps, so that it is compiled anew.
        sparse = solve_joint(problem, jnp.asarray(truth), scales, max_level_steps=13)
        assert found.converged
        assert sparse.converged
        np.testing.assert_allclose(sparse.poses, found.poses, atol=1e-7)
        assert sparse.cost_after < found.cost_before


@pytest.mark.parametrize("direct_maps", [8, 2])
def test_derivatives_equal_finite_differences(monkeypatch, direct_maps):
    """Of the poses with respect to points and weights: forward and reverse, decomposed and by conjugate gradients."""
    monkeypatch.setattr("voxjax.refinement.solve.joint.DIRECT_MAPS", direct_maps)
    rng = np.random.default_rng(4)
    with jax.enable_x64(True):
        problem, truth = corner_problem(rng, 4, [(0, 1), (2, 1), (2, 0), (3, 0)], more=0)
        start, scales = jnp.asarray(truth), jnp.asarray([0.2])
        leaves, struct = jax.tree.flatten(problem)
        is_float = [jnp.issubdtype(leaf.dtype, jnp.floating) for leaf in leaves]
        ways = [
            jnp.asarray(rng.normal(size=leaf.shape)) if real else None
            for leaf, real in zip(leaves, is_float, strict=True)
        ]

        def value(step, leaves):
            moved = [
                leaf if way is None else leaf + step * way for leaf, way in zip(leaves, ways, strict=True)
            ]
            poses = solve_joint(
                jax.tree.unflatten(struct, moved), start, scales, max_level_steps=20 + direct_maps
            ).poses
            return jnp.sum(poses * target, dtype=poses.dtype)

        target = jnp.asarray(rng.normal(size=(4, 4, 4)))
        check_derivatives(value, leaves)


def check_derivatives(value, given, h=1e-5):
    """Forward and reverse mode of `value(step, given)` at a step of 0 equal finite differences."""

    @jax.jit
    def all_at(step, given):
        one = jnp.ones_like(step)
        return derivatives_at(lambda step: value(step, given), step, one, one)

    _, forward, reverse = all_at(jnp.zeros(()), given)
    high, low = (all_at(jnp.asarray(step), given)[0] for step in (h, -h))
    expected = (high - low) / (2 * h)
    assert abs(float(expected)) > 1e-2
    np.testing.assert_allclose(forward, expected, rtol=1e-4)
    np.testing.assert_allclose(reverse, expected, rtol=1e-4)


def test_derivatives_in_tables_that_pairs_share(team):
    """Of planes in float64, with one pair that does not overlap: finite, and right where finite differences are."""
    maps, _, starts, _ = team
    with jax.enable_x64(True):
        problem = joint_problem(
            maps, [(0, 1), (2, 1), (4, 2)], np.arange(5) == 0, num_points=256, loss="geman_mcclure"
        )
        leaves, struct = jax.tree.flatten(problem)
        leaves = [
            jnp.asarray(leaf, jnp.float64) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf
            for leaf in leaves
        ]
        problem = jax.tree.unflatten(struct, leaves)
        start, scales = jnp.asarray(np.stack(starts)), jnp.asarray([0.1])

        def value(offset, problem):
            surface = problem.edges[0].common.terms[0].surface
            moved = surface._replace(points=surface.points + offset * surface.normals)
            other = eqx.tree_at(lambda p: p.edges[0].common.terms[0].surface, problem, moved)
            # Held: while matches are looked up, they jump.
            poses = solve_joint(other.holding(other.met(start)), start, scales).poses
            return jnp.sum(poses[:3, :3, 3], dtype=poses.dtype)

        # As an argument: the tables of the maps would be constants of the kernel.
        check_derivatives(value, problem)
