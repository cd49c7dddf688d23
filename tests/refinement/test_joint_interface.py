"""What `refine` can do for a pair, `refine_joint` can for many: residuals, terms, log-odds, far starts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from derivatives import derivatives_at
from oracles.motions import moved, nudged, pose_error
from oracles.rooms import VOXEL
from refinement_problems import KINDS, LOOP, starts_near
from voxjax.fusion.rules import log_odds_of_states
from voxjax.refinement.problems.joint import joint_problem
from voxjax.refinement.problems.joint_pairs import checked_terms, with_named
from voxjax.refinement.problems.views import soft_map
from voxjax.refinement.refine_joint import refine_joint
from voxjax.refinement.residuals.known import CornerPairs, Prior
from voxjax.refinement.solve.joint import solve_joint

POINTS = 256


ONE_LEVEL = {"max_distance": VOXEL, "final_distance": VOXEL, "num_points": POINTS}


def with_log_odds(grid, odds=None):
    odds = log_odds_of_states(jnp.asarray(grid.states)) if odds is None else odds
    return vx.VoxelGrid(grid.states, grid.origin, grid.voxel_size, odds)


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("kind", list(KINDS))
def test_two_maps_end_where_a_pair_does(maps, grids, truth, kind, soft):
    given = [with_log_odds(grid) for grid in grids[0][:2]] if soft else maps[:2]
    starts = starts_near(truth, maps, 1, metres=0.03, degrees=0.3)[:2]
    # All kinds together are led there level by level, each alone goes down the last one: half as much to compile.
    reach = 2 * VOXEL if kind == "all" else VOXEL
    options = {"residuals": KINDS[kind], "num_points": 1024, "soft": soft, "max_distance": reach}
    pair = vx.refine(given[0], given[1], starts[1], both_ways=True, **options)
    joint = refine_joint(given, starts, pairs=[(0, 1)], **options)
    angle, gap = pose_error(joint.poses[1], pair.T_a_b, maps[1].centroid)
    # Each holds the matches that it found last.
    assert angle < 0.03
    assert gap < 0.02 * VOXEL
    np.testing.assert_allclose(joint.cost_after, pair.cost_after, rtol=1e-3)
    np.testing.assert_allclose(joint.cost_before, pair.cost_before, rtol=1e-4)


def test_terms_pull_the_pairs_that_they_name(maps, truth):
    """Corners pull one map off its surfaces, and a prior places one that no map overlaps."""
    rng = np.random.default_rng(2)
    starts = starts_near(truth, maps, 2, metres=0.05, degrees=0.5)
    starts[2] = starts[2].copy()
    starts[2][:3, 3] += 20.0
    # Where the corners say that map 1 is: three centimetres off.
    told = truth[1].copy()
    told[:3, 3] += [0.03, 0.0, 0.0]
    corners = rng.uniform(-2, 2, (7, 3)) + np.asarray(maps[1].centroid)[None, :]
    pull = CornerPairs(
        of_a=moved(told, corners).astype(np.float32),
        of_b=corners.astype(np.float32),
        share=np.full(7, 100.0, np.float32),
        loss="squared",
    )
    believed = nudged(
        np.linalg.inv(starts[1]) @ starts[2], maps[2].centroid, rng, metres=0.2, degrees=2.0
    ).astype(np.float32)
    prior = Prior(believed, maps[2].centroid, 10.0 * np.eye(6, dtype=np.float32))
    found = refine_joint(maps, starts, terms={(0, 1): [pull], (1, 2): [prior]}, **ONE_LEVEL)
    assert found.pairs == ((0, 1), (1, 2))
    assert found.held == (0,)
    angle, gap = pose_error(found.poses[1], told, maps[1].centroid)
    assert angle < 0.01
    assert gap < 1e-3
    between = np.linalg.inv(np.asarray(found.poses[1], np.float64)) @ np.asarray(found.poses[2], np.float64)
    angle, gap = pose_error(between, believed, maps[2].centroid)
    assert angle < 0.01
    assert gap < 1e-3
    # Planes do not see the map that the prior places.
    assert found.result == vx.RESULTS.degenerate


def test_far_starts_are_led_together_along_coarser_maps(maps, truth):
    starts = starts_near(truth, maps, 7, metres=2.0, degrees=15.0)

    def errors(max_distance):
        # Two levels, as on coarser maps, and as many points: one kernel for all.
        found = refine_joint(maps, starts, final_distance=2 * VOXEL, max_distance=max_distance)
        assert found.pairs == ((0, 1), (0, 2), (1, 2))
        assert found.cost_after <= found.cost_before
        return np.array([pose_error(found.poses[n], truth[n], maps[n].centroid) for n in (1, 2)])

    near, led = errors(None), errors(16 * VOXEL)
    assert near[:, 1].max() > 5 * VOXEL
    assert led[:, 1].max() < 0.2 * VOXEL
    assert led[:, 0].max() < 0.3


@pytest.mark.parametrize("kind", list(KINDS))
def test_log_odds_of_three_maps_in_a_loop_in_float64(grids, maps, truth, kind):
    """Derivatives of the poses, forward and reverse, against finite differences that leave the matches as they are."""
    starts = starts_near(truth, maps, 6, metres=0.05, degrees=0.5)
    rng = np.random.default_rng(7)
    with jax.enable_x64(True):
        soft = [soft_map(grid) for grid in grids[0]]
        odds = [jnp.asarray(log_odds_of_states(jnp.asarray(grid.states)), jnp.float64) for grid in grids[0]]
        ways = [jnp.asarray(rng.normal(size=each.shape)) for each in odds]
        start, scales = jnp.asarray(np.stack(starts)), jnp.asarray([VOXEL])

        def refined(odds):
            views = [part.view(each) for part, each in zip(soft, odds, strict=True)]
            problem = joint_problem(views, LOOP, np.arange(3) == 0, residuals=KINDS[kind], num_points=POINTS)
            return solve_joint(problem, start, scales).poses[1:, :3]

        def after(step):
            return refined([o + step * way for o, way in zip(odds, ways, strict=True)])

        # Solutions are good to 1e-10 m, which one short step shows as up to 1e-5 of slope; along a long one a point
        # may meet another plane. The middle one of three slopes has neither.
        steps = (1e-5 if "planes" in KINDS[kind] else 6e-5) * np.array([3.0, 4.0, 5.0])
        pull = jnp.asarray(rng.normal(size=(2, 3, 4)))
        _, found, back = derivatives_at(refined, odds, ways, pull)
        differences = [after(step) - after(-step) for step in steps]
        slopes = [difference / (2 * step) for step, difference in zip(steps, differences, strict=True)]
        expected = jnp.median(jnp.stack(slopes), axis=0)
        size = float(jnp.abs(expected).max())
        assert size > 1e-4
        np.testing.assert_allclose(found, expected, atol=1e-3 * size)
        total = sum(float(jnp.sum(part * way)) for part, way in zip(back, ways, strict=True))
        np.testing.assert_allclose(total, float(jnp.sum(pull * found)), rtol=1e-6)


def test_gradients_reach_the_log_odds_through_the_public_verb(grids, maps, truth):
    """Forward and reverse; also from the solution, which is kept once no better one is found."""
    starts = starts_near(truth, maps, 8, metres=0.05, degrees=0.5)
    odds = [log_odds_of_states(jnp.asarray(grid.states)) for grid in grids[0]]
    rng = np.random.default_rng(9)
    ways = [jnp.asarray(rng.normal(size=each.shape), jnp.float32) for each in odds]

    def probe(odds, starts):
        given = [with_log_odds(grid, each) for grid, each in zip(grids[0], odds, strict=True)]
        found = refine_joint(given, starts, pairs=LOOP, soft=True, **ONE_LEVEL).poses
        return found[2, 0, 3], found

    for _ in range(4):
        start = starts
        slopes, starts = jax.grad(probe, has_aux=True)(odds, start)
        _, forward = jax.jvp(lambda odds, start=start: probe(odds, start)[0], (odds,), (ways,))
        total = sum(float(jnp.sum(slope * way)) for slope, way in zip(slopes, ways, strict=True))
        np.testing.assert_allclose(total, forward, rtol=1e-3)
        for grid, slope in zip(grids[0], slopes, strict=True):
            assert np.isfinite(slope).all()
            assert np.abs(slope).max() > 0
            # Planes are made of occupied voxels only.
            assert (np.asarray(slope)[np.asarray(grid.states) != 2] == 0).all()


def test_traced_log_odds_and_starts_are_refused_where_they_would_not_count(grids, maps, truth):
    def by_odds(odds):
        given = [with_log_odds(grids[0][0], odds), *maps[1:]]
        return refine_joint(given, truth, pairs=LOOP, **ONE_LEVEL).poses[1, 0, 3]

    with pytest.raises(vx.InputError, match=r"grids\[0\].*soft=True"):
        jax.grad(by_odds)(jnp.zeros(grids[0][0].shape, jnp.float32))
    with pytest.raises(vx.InputError, match=r"grids\[1\].*log_odds"):
        refine_joint([with_log_odds(grids[0][0]), *grids[0][1:]], truth, soft=True)
    with pytest.raises(vx.InputError, match=r"poses\[0\].*solve_joint"):
        jax.jit(lambda T: refine_joint(maps, [T, *truth[1:]], pairs=LOOP).poses)(jnp.eye(4))


def some_prior():
    return Prior(np.eye(4, dtype=np.float32), np.zeros(3, np.float32), np.eye(6, dtype=np.float32))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"residuals": {"corners": 1.0}}, "residuals"),
        ({"residuals": {"planes": 0.0}}, "positive"),
        ({"residuals": {}}, "at least one"),
        ({"terms": {(1, 0): []}}, r"T_0_1"),
        ({"terms": {(0, 1): [], (1, 0): []}, "pairs": None}, "once"),
        ({"terms": {(0, 3): []}}, "terms"),
        ({"terms": {(1, 1): []}}, "terms"),
    ],
)
def test_bad_input_is_one_sentence(maps, truth, changes, word):
    with pytest.raises(vx.InputError, match=word):
        refine_joint(maps, truth, **({"pairs": LOOP} | changes))


def test_named_pairs_are_held_the_way_round_that_they_are_named():
    terms = checked_terms({(2, 0): [some_prior()], (3, 1): []}, None, 4)
    assert list(terms) == [(2, 0), (3, 1)]
    assert len(terms[2, 0]) == 1
    assert with_named([(0, 1), (0, 2)], terms) == [(0, 1), (2, 0), (3, 1)]
    assert checked_terms(None, [(0, 1)], 2) == {}
