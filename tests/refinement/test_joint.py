import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import nudged, pose_error, random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.maps.joint import joint_problem
from voxjax.refinement.maps.joint_pairs import connected_parts, overlapping_pairs
from voxjax.refinement.refine_joint import refine_joint
from voxjax.refinement.residuals.losses import Loss
from voxjax.refinement.residuals.pairs import CornerPairs
from voxjax.refinement.residuals.terms import Level
from voxjax.refinement.solve.equations import dense_equations, move_about
from voxjax.refinement.solve.joint import solve_joint
from voxjax.refinement.solve.joint_equations import JointEquations, dense_step, sparse_step
from voxjax.refinement.solve.joint_problem import JointProblem, edges_of
from voxjax.refinement.solve.problem import PoseProblem

POINTS = 1024
LOOP = [(0, 1), (1, 2), (3, 2), (0, 3)]


@pytest.fixture(scope="module")
def team():
    """Four maps of a room in frames of their own and one without a neighbour, true poses, starts, and centroids."""
    rng = np.random.default_rng(7)
    room = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    truth = [random_pose(rng, metres=3, degrees=40) for _ in range(4)]
    maps = [prepare_map(room.transformed(np.linalg.inv(T))) for T in truth]
    truth.append(np.eye(4))
    truth[4][:3, 3] = 200.0
    maps.append(maps[0])
    centroids = [np.asarray(each.centroid) for each in maps]
    starts = [
        nudged(T, c, rng, metres=0.1, degrees=1.0) if number else T
        for number, (T, c) in enumerate(zip(truth, centroids, strict=True))
    ]
    return maps, truth, starts, centroids


def errors(poses, truth, centroids, numbers=range(4)):
    """Degrees and metres of each map."""
    return np.array([pose_error(poses[n], truth[n], centroids[n]) for n in numbers])


@pytest.mark.slow
def test_a_loop_ends_nearer_to_the_truth_than_a_chain_of_pairs(team):
    maps, truth, starts, centroids = team
    found = refine_joint(maps, starts, pairs=LOOP, num_points=POINTS)
    assert found.result == vx.RESULTS.successful
    assert found.pairs == tuple(LOOP)
    assert found.cost_after < found.cost_before
    chained = [starts[0]]
    for a in range(3):
        start = np.linalg.inv(starts[a]) @ starts[a + 1]
        T_a_b = vx.refine(maps[a], maps[a + 1], start, num_points=POINTS, both_ways=True).T_a_b
        chained.append(chained[-1] @ np.asarray(T_a_b, np.float64))
    joint, chain = (errors(poses, truth, centroids) for poses in (found.poses, chained))
    # The last map is drawn in a frame in which its voxels lean by about so much: pairs find the same.
    assert joint[:, 0].max() < 0.5
    assert joint[:, 1].max() < 0.1 * VOXEL
    assert joint[1:, 0].mean() <= chain[1:, 0].mean()
    assert joint[1:, 1].mean() <= chain[1:, 1].mean()
    assert np.isfinite(found.covariance).all()
    sigma = np.sqrt(np.trace(found.covariance[1:4, :3, :3], axis1=1, axis2=2))
    assert (joint[1:, 1] < 3 * sigma).all()
    assert (sigma < VOXEL).all()


def test_the_order_of_maps_and_pairs_does_not_matter(team):
    maps, _, starts, centroids = team
    found = refine_joint(maps, starts, pairs=LOOP, num_points=POINTS)
    order = [3, 1, 4, 0, 2]
    place = np.argsort(order)
    pairs = [(int(place[b]), int(place[a])) for a, b in LOOP[::-1]]
    other = refine_joint(
        [maps[n] for n in order],
        [starts[n] for n in order],
        pairs=pairs,
        anchor=int(place[0]),
        num_points=POINTS,
    )
    gaps = errors([other.poses[place[n]] for n in range(5)], found.poses, centroids)
    # Points keep the matches that they found last, which a step of rounding may change.
    assert gaps[:, 0].max() < 0.05
    assert gaps[:, 1].max() < 0.03 * VOXEL


def test_two_maps_equal_a_pair_and_what_is_held_stays_bit_for_bit(team):
    maps, _, starts, centroids = team
    found = refine_joint(maps, starts, pairs=[(0, 1), (2, 3)], anchor=1, num_points=POINTS)
    assert found.held == (1, 2, 4)
    assert found.unpaired == (4,)
    np.testing.assert_array_equal(
        np.asarray(found.poses)[[1, 2, 4]], np.asarray(starts, np.float32)[[1, 2, 4]]
    )
    np.testing.assert_array_equal(np.asarray(found.covariance)[[1, 2, 4]], 0.0)
    for a, b in found.pairs:
        start = np.linalg.inv(starts[a]) @ starts[b]
        pair = vx.refine(maps[a], maps[b], start, num_points=POINTS, both_ways=True).T_a_b
        joint = np.linalg.inv(np.asarray(found.poses[a], np.float64)) @ np.asarray(found.poses[b], np.float64)
        angle, gap = pose_error(joint, pair, centroids[b])
        # Both pairs share one damping here, so that other matches may be held at the end.
        assert angle < 0.08
        assert gap < 0.03 * VOXEL


def test_a_pair_without_overlap_changes_nothing_and_is_finite(team):
    maps, _, starts, _ = team
    far = [T.copy() for T in starts]
    far[3][0, 3] += 100.0
    found = refine_joint(maps, far, pairs=[(0, 1), (2, 3)], num_points=POINTS)
    assert found.result == vx.RESULTS.degenerate
    assert np.isfinite(found.poses).all()
    assert np.isfinite(found.covariance).all()
    np.testing.assert_allclose(found.poses[3], far[3], atol=1e-4)
    assert np.abs(np.asarray(found.poses[1]) - starts[1]).max() > 1e-3


def test_maps_that_overlap_are_found(team):
    maps, _, starts, _ = team
    poses = np.asarray(starts, np.float32)
    assert overlapping_pairs([*maps, None], np.concatenate([poses, poses[:1]])) == list(
        itertools.combinations(range(4), 2)
    )
    np.testing.assert_array_equal(connected_parts(6, [(4, 2), (5, 3), (2, 5)]), [0, 1, 2, 2, 2, 2])


def test_nothing_to_refine_is_an_outcome(team):
    maps, _, starts, _ = team
    empty = vx.VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3, np.float32), VOXEL)
    alone = refine_joint([maps[0], maps[4]], [starts[0], starts[4]])
    assert alone.result == vx.RESULTS.no_overlap
    assert alone.unpaired == alone.held == (0, 1)
    np.testing.assert_array_equal(alone.poses, np.asarray([starts[0], starts[4]], np.float32))
    assert refine_joint([maps[0], empty], starts[:2], pairs=[(0, 1)]).result == vx.RESULTS.empty_map


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"poses": [np.eye(4)]}, "grids and poses"),
        ({"poses": [np.eye(4), np.ones((4, 4))]}, r"poses\[1\]"),
        ({"anchor": 2}, "anchor"),
        ({"pairs": [(0, 2)]}, "pairs"),
        ({"pairs": [(1, 1)]}, "pairs"),
        ({"pairs": [(0, 1), (1, 0)]}, "pairs"),
        ({"num_points": 0}, "num_points"),
        ({"max_distance": 0.0}, "max_distance"),
    ],
)
def test_bad_input_is_one_sentence(team, changes, word):
    with pytest.raises(vx.InputError, match=word):
        refine_joint(**({"grids": team[0][:2], "poses": [np.eye(4), np.eye(4)]} | changes))


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


def test_blocks_equal_the_dense_jacobian():
    with jax.enable_x64(True):
        pairs = [(0, 1), (2, 1), (2, 3), (3, 0), (1, 3)]
        # Of other losses the matrix is that of weighted squares.
        problem, truth = corner_problem(np.random.default_rng(0), 4, pairs, loss="squared")
        assert [group.first.shape[0] for group in problem.edges] == [3, 2]
        poses, level = jnp.asarray(truth), Level(jnp.asarray(0.1), jnp.int32(0))

        def rows(tangents):
            moved = jax.vmap(move_about)(poses, problem.centroids, tangents.reshape(-1, 6))
            return problem.rows(moved, level)

        expected = jax.jit(lambda tangents: dense_equations(rows, tangents))(jnp.zeros(24))
        found = jax.jit(lambda where: problem.equations(where, level))(poses)
        np.testing.assert_allclose(found.cost, expected.cost, rtol=1e-12)
        cost = jax.jit(lambda where: problem.cost(where, level))(poses)
        np.testing.assert_allclose(2 * found.cost, cost, rtol=1e-12)
        np.testing.assert_allclose(found.slope.reshape(-1), expected.slope, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.dense(), expected.matrix, rtol=1e-9, atol=1e-7)
        move = np.random.default_rng(1).normal(size=(4, 6))
        product = np.asarray(expected.matrix) @ move.reshape(-1)
        np.testing.assert_allclose(found.times(move).reshape(-1), product, rtol=1e-9, atol=1e-7)
        falls = -move.reshape(-1) @ (np.asarray(expected.slope) + 0.5 * product)
        np.testing.assert_allclose(found.fall(jnp.asarray(move)), falls, rtol=1e-9)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_factors_and_conjugate_gradients_give_the_same_step(dtype):
    rng = np.random.default_rng(2)
    first = np.array([0, 1, 2, 3, 4, 0])
    second = np.array([1, 2, 3, 4, 5, 3])
    rows = rng.normal(size=(6, 8, 12))
    whole = np.zeros((6, 6, 6, 6))
    for a, b, jacobian in zip(first, second, rows, strict=True):
        whole[np.ix_([a, b], range(6), [a, b], range(6))] += (jacobian.T @ jacobian).reshape(2, 6, 2, 6)
    slope = rng.normal(size=(6, 6))
    with jax.enable_x64(dtype == np.float64):
        equations = JointEquations(
            jnp.zeros((), dtype),
            jnp.asarray(slope, dtype),
            jnp.asarray(whole[range(6), :, range(6), :], dtype),
            jnp.asarray(whole[first, :, second, :], dtype),
            jnp.asarray(first, jnp.int32),
            jnp.asarray(second, jnp.int32),
        )
        damped = equations.damped(jnp.asarray(0.1, dtype))
        dense = whole.reshape(36, 36)
        expected = -np.linalg.solve(dense + 0.1 * np.diag(np.diag(dense)), slope.reshape(-1)).reshape(6, 6)
        np.testing.assert_allclose(dense_step(damped), expected, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(sparse_step(damped), dense_step(damped), rtol=1e-3, atol=1e-3)


@pytest.mark.slow
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


@pytest.mark.parametrize("direct_maps", [8, pytest.param(2, marks=pytest.mark.slow)])
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

        def value(step):
            moved = [
                leaf if way is None else leaf + step * way for leaf, way in zip(leaves, ways, strict=True)
            ]
            poses = solve_joint(
                jax.tree.unflatten(struct, moved), start, scales, max_level_steps=20 + direct_maps
            ).poses
            return jnp.sum(poses * target, dtype=poses.dtype)

        target = jnp.asarray(rng.normal(size=(4, 4, 4)))
        check_derivatives(value)


def check_derivatives(value, h=1e-5):
    """Forward and reverse mode at 0 equal finite differences."""

    @jax.jit
    def all_at(step):
        return *jax.jvp(value, (step,), (jnp.ones_like(step),)), jax.grad(value)(step)

    _, forward, reverse = all_at(jnp.zeros(()))
    high, low = (all_at(jnp.asarray(step))[0] for step in (h, -h))
    expected = (high - low) / (2 * h)
    assert abs(float(expected)) > 1e-2
    np.testing.assert_allclose(forward, expected, rtol=1e-4)
    np.testing.assert_allclose(reverse, expected, rtol=1e-4)


@pytest.mark.slow
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

        def value(offset):
            surface = problem.edges[0].common.terms[0].surface
            moved = surface._replace(points=surface.points + offset * surface.normals)
            other = eqx.tree_at(lambda p: p.edges[0].common.terms[0].surface, problem, moved)
            # Held: while matches are looked up, they jump.
            poses = solve_joint(other.holding(other.met(start)), start, scales).poses
            return jnp.sum(poses[:3, :3, 3], dtype=poses.dtype)

        check_derivatives(value)
