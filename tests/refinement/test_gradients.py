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


class Solve(eqx.Module):
    """What a refined pose may depend on.

    Attributes:
        problem: Residuals between the maps.
        T: Start.
        scales: Robust scales [m].
    """

    problem: PoseProblem
    T: Any
    scales: Any

    def tangent(self, base):
        """The refined pose as six numbers about a pose."""
        T = solve_pose(self.problem, self.T, self.scales).T_a_b
        return tangent_between(base, T, self.problem.centroid)


@eqx.filter_jit
def derivatives(solve, base, way, pull):
    """The tangent, its derivative along a way, and what reverse mode makes of `pull`, in all that floats.

    It is one kernel for each kind of problem and dtype, whatever a test moves: compiling is most of the work here.
    """
    floats, others = eqx.partition(solve, eqx.is_inexact_array)
    return derivatives_at(lambda floats: eqx.combine(floats, others).tangent(base), floats, way, pull)


def along(solve, *parts):
    """A way in which some floating arrays move and all others stay.

    Args:
        solve: What is moved.
        parts: (where, direction) of each array that moves.
    """
    way = jax.tree.map(jnp.zeros_like, eqx.filter(solve, eqx.is_inexact_array))
    for where, direction in parts:
        way = eqx.tree_at(where, way, jnp.asarray(direction, where(way).dtype))
    return way


def moved(solve, way, step):
    """`solve` after a step along a way."""
    floats, others = eqx.partition(solve, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(lambda x, d: x + step * d, floats, way), others)


def inner(a, b):
    """Inner product of two trees of floating arrays."""
    return sum(jnp.sum(x * y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


def assert_derivative(solve, base, way, *, step, rtol, after=None):
    """Forward mode, reverse mode and central differences along a way agree; returns what reverse mode gives.

    Args:
        solve: Where.
        base: Pose about which tangents are.
        way: Direction, see `along`.
        step: Length of the differences; half and twice of it are taken too.
        rtol: Share of the largest entry.
        after: `solve` after a step, where that is not along a straight line.
    """
    after = after or (lambda step: moved(solve, way, step))
    pull = jnp.asarray(np.random.default_rng(9).normal(size=6))
    _, found, back = derivatives(solve, base, way, pull)
    # The solver may end a descent one step of 1e-9 of a scale earlier on one side: the median leaves such a step out.
    slopes = []
    for length in (0.5 * step, step, 2.0 * step):
        (ahead, *_), (behind, *_) = (derivatives(after(k * length), base, way, pull) for k in (1, -1))
        slopes.append((ahead - behind) / (2 * length))
    expected = jnp.median(jnp.stack(slopes), axis=0)
    size = float(jnp.abs(expected).max())
    assert size > 0
    np.testing.assert_allclose(found, expected, atol=rtol * size)
    np.testing.assert_allclose(inner(back, way), jnp.sum(pull * found), rtol=1e-6, atol=1e-9 * size)
    return back


def solve_of(problem, start, dtype: Any = np.float64):
    """The problem from a start, at the last robust scale alone."""
    return Solve(as_dtype(problem, dtype), jnp.asarray(start, dtype), jnp.asarray(SCALES, dtype))


def weights_of(solve):
    """Weights of the points of the first term."""
    return solve.problem.terms[0].sample.weights


@pytest.mark.parametrize("kind", KINDS)
def test_weights_in_float64(prepared, start, kind, small):
    with jax.enable_x64(True):
        solve = solve_of(small(pose_problem(*prepared, residuals=KINDS[kind], num_points=POINTS)), start)
        direction = weights_of(solve) * jnp.asarray(np.random.default_rng(0).normal(size=POINTS))
        assert_derivative(solve, solve.T, along(solve, (weights_of, direction)), step=1e-5, rtol=1e-4)


@pytest.mark.parametrize(
    ("kind", "which"),
    list(itertools.product(("planes", "occupancies", "distances"), (0, 1))),
)
def test_log_odds_of_either_map_in_float64(room, start, kind, which):
    with jax.enable_x64(True):
        soft = [soft_map(grid) for grid in room[:2]]
        odds = [jnp.asarray(log_odds_of_states(jnp.asarray(grid.states)), jnp.float64) for grid in room[:2]]

        def solve_with(changed):
            views = [s.view(changed if k == which else odds[k]) for k, s in enumerate(soft)]
            return solve_of(pose_problem(*views, residuals=KINDS[kind], num_points=POINTS), start)

        # The problem moves along what the log-odds make of it, and reverse mode goes back through that.
        direction = jnp.asarray(np.random.default_rng(2).normal(size=odds[which].shape))
        _, way, back_of = derivatives_at(
            lambda changed: eqx.filter(solve_with(changed), eqx.is_inexact_array), odds[which], direction
        )
        back = assert_derivative(
            solve_with(odds[which]),
            jnp.asarray(start, jnp.float64),
            way,
            step=1e-3,
            rtol=1e-4,
            after=lambda step: solve_with(odds[which] + step * direction),
        )
        np.testing.assert_allclose(jnp.sum(back_of(back) * direction), inner(back, way), rtol=1e-6)


def test_parameters_of_residuals_and_the_last_scale_in_float64(prepared, start, small):
    with jax.enable_x64(True):
        solve = solve_of(small(pose_problem(*prepared, num_points=POINTS)), start)
        solve = eqx.tree_at(lambda s: s.problem.terms[0].slide, solve, jnp.full((), 0.1, jnp.float64))
        way = along(solve, (lambda s: s.problem.terms[0].slide, 1.0), (lambda s: s.scales, [0.3]))
        # Differences of solutions, each good to about 1e-9 of a scale: a shorter step would show that.
        assert_derivative(solve, solve.T, way, step=5e-5, rtol=1e-4)


def with_prior(solve, weight):
    """A further term that holds the start."""
    problem, T = solve.problem, solve.T
    prior = Prior(T, jnp.asarray(problem.centroid), weight * jnp.eye(6, dtype=T.dtype))
    return Solve(PoseProblem((*problem.terms, prior), problem.centroid, problem.radius), T, solve.scales)


def test_the_start_counts_where_a_prior_holds_it(prepared, start, small):
    with jax.enable_x64(True):
        free = solve_of(small(pose_problem(*prepared, num_points=POINTS)), start)
        base, direction = free.T, jnp.asarray([0.3, -0.2, 0.5, 0.1, 0.0, -0.1])

        def turned(step):
            return move_about(base, free.problem.centroid, 1e-3 + step * direction)

        def after(step, weight=1.0):
            return with_prior(Solve(free.problem, turned(step), free.scales), weight)

        change = jax.jvp(turned, (0.0,), (1.0,))[1]
        held = after(0.0)
        way = along(held, (lambda s: s.T, change), (lambda s: s.problem.terms[-1].T_a_b, change))
        assert_derivative(held, base, way, step=1e-5, rtol=1e-4, after=after)
        # A prior of no weight holds nothing.
        _, found, back = derivatives(after(0.0, weight=0.0), base, way, jnp.ones(6))
        np.testing.assert_allclose(found, 0.0, atol=1e-12)
        for part in (back.T, back.problem.terms[-1].T_a_b):
            np.testing.assert_allclose(part, 0.0, atol=1e-12)


def test_float32_agrees_with_float64(prepared, start, small):
    def by_weights(dtype):
        solve = solve_of(small(pose_problem(*prepared, num_points=POINTS)), start, dtype)
        rows = [
            weights_of(derivatives(solve, solve.T, along(solve), pull)[2]) for pull in jnp.eye(6, dtype=dtype)
        ]
        return np.stack(rows)

    single = by_weights(np.float32)
    with jax.enable_x64(True):
        double = by_weights(np.float64)
    assert single.dtype == np.float32
    assert double.dtype == np.float64
    np.testing.assert_allclose(single, double, atol=2e-2 * np.abs(double).max())


def test_derivatives_are_finite_where_nothing_is_known(prepared, small):
    """Empty overlap, no weights, no rotation, half a turn, in all combinations, forward and reverse."""
    problem = small(pose_problem(*prepared, residuals=KINDS["both"], num_points=POINTS))
    rng = np.random.default_rng(3)
    for is_far, weight, is_half_turn in itertools.product((False, True), (0.0, 1.0), (False, True)):
        T = np.eye(4, dtype=np.float32)
        if is_half_turn:
            T[:3, :3] = np.diag([-1.0, -1.0, 1.0])
        T[:3, 3] += 1000.0 * is_far
        solve = with_prior(solve_of(problem, T, np.float32), 0.0)
        solve = eqx.tree_at(weights_of, solve, jnp.full(POINTS, np.float32(weight / POINTS)))
        # What is not finite along any array is not finite along all of them.
        way = jax.tree.map(
            lambda x: jnp.asarray(rng.uniform(0.5, 1.0, x.shape), x.dtype),
            eqx.filter((solve.T, solve.problem.terms[0].slide), eqx.is_inexact_array),
        )
        way = along(solve, (lambda s: s.T, way[0]), (lambda s: s.problem.terms[0].slide, way[1]))
        _, found, _ = derivatives(solve, solve.T, way, jnp.ones(6))
        assert np.isfinite(found).all()
        for pull in jnp.eye(6):
            _, _, back = derivatives(solve, solve.T, way, pull)
            for part in (back.T, weights_of(back), back.problem.terms[0].slide):
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
    solve = solve_of(small(pose_problem(*prepared, num_points=POINTS)), start, np.float32)
    found = solve_pose(solve.problem, solve.T, solve.scales).T_a_b
    pull = jnp.eye(6)[0]
    first, again = (
        weights_of(derivatives(each, solve.T, along(each), pull)[2])
        for each in (solve, Solve(solve.problem, found, solve.scales))
    )
    assert np.abs(first).max() > 0
    # A few points meet other planes from there.
    assert np.corrcoef(first, again)[0, 1] > 0.8
