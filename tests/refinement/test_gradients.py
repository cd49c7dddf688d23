"""Derivatives of refined poses against finite differences, in float64 and float32, forward and reverse."""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from derivatives import derivatives_at
from oracles.motions import nudged
from oracles.rooms import VOXEL
from voxjax.fusion.rules import log_odds_of_states
from voxjax.refinement.problems.pair import as_dtype, pose_problem
from voxjax.refinement.problems.views import soft_map
from voxjax.refinement.residuals.known import Prior, tangent_between
from voxjax.refinement.solve.equations import move_about
from voxjax.refinement.solve.pose import solve_pose
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 512


SCALES = np.asarray([1.0]) * VOXEL


KINDS = {
    "planes": {"planes": 1.0},
    "distances": {"distances": 1.0},
    "occupancies": {"occupancies": 1.0},
    "both": {"planes": 1.0, "occupancies": 0.3},
}


@pytest.fixture(scope="module")
def start(room):
    return nudged(
        room[2], room[1].occupied_points().mean(axis=0), np.random.default_rng(1), metres=0.05, degrees=0.5
    )


def tangent_of(problem, start, scales):
    """The refined pose as six numbers about the start."""
    T = solve_pose(problem, start, scales).T_a_b
    return tangent_between(jax.lax.stop_gradient(start), T, problem.centroid)


def planes_of(problem) -> Any:
    """The first term, whose fields depend on its kind."""
    return problem.terms[0]


def assert_derivative(function, value, direction, *, step, rtol, jit=eqx.filter_jit):
    """Forward mode, reverse mode and central differences along a direction agree."""
    pull = jnp.asarray(np.random.default_rng(9).normal(size=6))
    at = jit(lambda v: derivatives_at(function, v, direction, pull))
    (_, found, back), (ahead, *_), (behind, *_) = (at(value + k * step * direction) for k in (0, 1, -1))
    expected = (ahead - behind) / (2 * step)
    size = float(jnp.abs(expected).max())
    assert size > 0
    np.testing.assert_allclose(found, expected, atol=rtol * size)
    np.testing.assert_allclose(jnp.sum(back * direction), jnp.sum(pull * found), rtol=1e-6, atol=1e-9 * size)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_in_float64(prepared, start, kind, small):
    with jax.enable_x64(True):
        problem = as_dtype(
            small(pose_problem(*prepared, residuals=KINDS[kind], num_points=POINTS)), np.float64
        )
        T, scales = jnp.asarray(start, jnp.float64), jnp.asarray(SCALES, jnp.float64)
        weights = planes_of(problem).sample.weights
        direction = weights * jnp.asarray(np.random.default_rng(0).normal(size=POINTS))

        def refined(weights):
            changed = eqx.tree_at(lambda p: p.terms[0].sample.weights, problem, weights)
            return tangent_of(changed, T, scales)

        assert_derivative(refined, weights, direction, step=1e-5, rtol=1e-4)


@pytest.mark.parametrize(
    ("kind", "which"),
    list(itertools.product(("planes", "occupancies", "distances"), (0, 1))),
)
def test_log_odds_of_either_map_in_float64(room, start, kind, which):
    with jax.enable_x64(True):
        soft = [soft_map(grid) for grid in room[:2]]
        rng = np.random.default_rng(2)
        odds = [jnp.asarray(log_odds_of_states(jnp.asarray(grid.states)), jnp.float64) for grid in room[:2]]
        T, scales = jnp.asarray(start, jnp.float64), jnp.asarray(SCALES, jnp.float64)

        def refined(changed):
            views = [s.view(changed if k == which else odds[k]) for k, s in enumerate(soft)]
            return tangent_of(pose_problem(*views, residuals=KINDS[kind], num_points=POINTS), T, scales)

        direction = jnp.asarray(rng.normal(size=odds[which].shape))
        # Compiled in parts: the tables of a map would be constants of one kernel.
        assert_derivative(refined, odds[which], direction, step=1e-3, rtol=1e-4, jit=lambda f: f)


def test_parameters_of_residuals_and_the_last_scale_in_float64(prepared, start, small):
    with jax.enable_x64(True):
        problem = as_dtype(small(pose_problem(*prepared, num_points=POINTS)), np.float64)
        T = jnp.asarray(start, jnp.float64)

        def refined(parameters):
            slide, scale = parameters
            changed = eqx.tree_at(lambda p: p.terms[0].slide, problem, slide)
            return tangent_of(changed, T, scale[None])

        # Differences of solutions, each good to about 1e-9 of a scale: a shorter step would show that.
        assert_derivative(refined, jnp.asarray([0.1, VOXEL]), jnp.asarray([1.0, 0.3]), step=1e-5, rtol=1e-4)


def test_the_start_counts_where_a_prior_holds_it(prepared, start, small):
    with jax.enable_x64(True):
        problem = as_dtype(small(pose_problem(*prepared, num_points=POINTS)), np.float64)
        base, scales = jnp.asarray(start, jnp.float64), jnp.asarray(SCALES, jnp.float64)

        def refined(tangent, weight):
            T = move_about(base, problem.centroid, tangent)
            prior = Prior(T, problem.centroid, weight * jnp.eye(6))
            held = PoseProblem((*problem.terms, prior), problem.centroid, problem.radius)
            return tangent_between(base, solve_pose(held, T, scales).T_a_b, problem.centroid)

        direction = jnp.asarray([0.3, -0.2, 0.5, 0.1, 0.0, -0.1])
        assert_derivative(lambda t: refined(t, 1.0), jnp.zeros(6) + 1e-3, direction, step=1e-5, rtol=1e-4)
        free = eqx.filter_jit(jax.jacfwd(lambda t: refined(t, 0.0)))(jnp.zeros(6))
        np.testing.assert_allclose(free, 0.0, atol=1e-12)


def test_float32_agrees_with_float64(prepared, start, small):
    def by_weights(dtype):
        problem = as_dtype(small(pose_problem(*prepared, num_points=POINTS)), dtype)

        def probe(weights):
            changed = eqx.tree_at(lambda p: p.terms[0].sample.weights, problem, weights)
            return tangent_of(changed, jnp.asarray(start, dtype), jnp.asarray(SCALES, dtype))

        return np.asarray(eqx.filter_jit(jax.jacrev(probe))(jnp.asarray(planes_of(problem).sample.weights)))

    single = by_weights(np.float32)
    with jax.enable_x64(True):
        double = by_weights(np.float64)
    assert single.dtype == np.float32
    assert double.dtype == np.float64
    np.testing.assert_allclose(single, double, atol=2e-2 * np.abs(double).max())


@pytest.mark.parametrize("is_forward", [False, True])
def test_derivatives_are_finite_where_nothing_is_known(prepared, small, is_forward):
    """Empty overlap, no weights, no rotation, half a turn, in all combinations."""
    problem = small(pose_problem(*prepared, residuals=KINDS["both"], num_points=POINTS))

    def refined(start, weights, slide):
        places = lambda p: [planes_of(p).sample.weights, planes_of(p).slide]
        changed = eqx.tree_at(places, problem, [weights, slide])
        prior = Prior(start, jnp.asarray(problem.centroid), jnp.zeros((6, 6), jnp.float32))
        changed = PoseProblem((*changed.terms, prior), changed.centroid, changed.radius)
        return solve_pose(changed, start, jnp.asarray(SCALES, jnp.float32)).T_a_b

    mode, argnums = (jax.jacfwd, (0, 2)) if is_forward else (jax.jacrev, (0, 1, 2))
    derivatives = eqx.filter_jit(mode(refined, argnums=argnums))
    for is_far, weight, is_half_turn in itertools.product((False, True), (0.0, 1.0), (False, True)):
        T = np.eye(4, dtype=np.float32)
        if is_half_turn:
            T[:3, :3] = np.diag([-1.0, -1.0, 1.0])
        T[:3, 3] += 1000.0 * is_far
        arguments = jnp.asarray(T), jnp.full(POINTS, np.float32(weight / POINTS)), jnp.float32(0.1)
        for part in derivatives(*arguments):
            assert np.isfinite(part).all()


def test_a_gradient_reaches_the_log_odds_through_the_public_verb(room, start):
    def probe(odds, T):
        grids = [
            vx.VoxelGrid(grid.states, grid.origin, grid.voxel_size, each)
            for grid, each in zip(room[:2], odds, strict=True)
        ]
        refined = vx.refine(grids[0], grids[1], T, soft=True, num_points=POINTS).T_a_b
        return refined[0, 3], refined

    odds, T = [jnp.asarray(log_odds_of_states(jnp.asarray(grid.states))) for grid in room[:2]], start
    # From the solution too, until no better one is found: the start is kept, with the derivative of the solution.
    for _ in range(4):
        slopes, T = jax.grad(probe, has_aux=True)(odds, T)
        for grid, slope in zip(room[:2], slopes, strict=True):
            assert np.isfinite(slope).all()
            assert np.abs(slope).max() > 0
            # Planes are made of occupied voxels only.
            assert (np.asarray(slope)[np.asarray(grid.states) != 2] == 0).all()


def test_traced_log_odds_without_soft_are_refused(room, start):
    a, b, _ = room

    def probe(odds):
        return vx.refine(vx.VoxelGrid(a.states, a.origin, a.voxel_size, odds), b, start).T_a_b[0, 3]

    with pytest.raises(vx.InputError, match="soft=True"):
        jax.grad(probe)(jnp.zeros(a.shape, jnp.float32))
    with pytest.raises(vx.InputError, match="log_odds"):
        vx.refine(a, b, start, soft=True)


def test_a_start_that_is_the_solution_has_its_derivative(prepared, start, small):
    problem = small(pose_problem(*prepared, num_points=POINTS))
    scales = jnp.asarray(SCALES, jnp.float32)
    found = solve_pose(problem, jnp.asarray(start, jnp.float32), scales).T_a_b

    def refined(weights, T):
        changed = eqx.tree_at(lambda p: planes_of(p).sample.weights, problem, weights)
        return solve_pose(changed, T, scales).T_a_b[0, 3]

    slope = eqx.filter_jit(jax.grad(refined))
    weights = jnp.asarray(planes_of(problem).sample.weights)
    first, again = slope(weights, jnp.asarray(start, jnp.float32)), slope(weights, found)
    assert np.abs(first).max() > 0
    # A few points meet other planes from there.
    assert np.corrcoef(first, again)[0, 1] > 0.8
