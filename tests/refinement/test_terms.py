"""Every kind of residual against its definition, and the normal equations against dense Jacobians."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles.motions import moved, nudged
from oracles.refinement import distance_from_plane, loss_of, trilinear
from oracles.rooms import VOXEL
from voxjax import rigid
from voxjax.ops.evidence.nearest import NOTHING_NEAR, split_keys
from voxjax.refinement.maps.pair import pose_problem
from voxjax.refinement.residuals.losses import robust_slope
from voxjax.refinement.residuals.pairs import CornerPairs, Prior, tangent_between
from voxjax.refinement.residuals.terms import Level, PointTerm
from voxjax.refinement.solve.equations import move_about, pose_equations

KINDS = ["planes", "distances", "occupancies"]
LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


@pytest.fixture(scope="module")
def start(room, prepared):
    """A pose a little off, so that no residual vanishes."""
    return jnp.asarray(
        nudged(room[2], prepared[1].centroid, np.random.default_rng(0), metres=0.04, degrees=0.7), jnp.float32
    )


def one_term(prepared, kind, **options) -> Any:
    return pose_problem(*prepared, residuals={kind: 1.0}, num_points=256, **options).terms[0]


def test_distances_are_those_of_the_pieces_of_plane_read_between_centres(prepared, start):
    a = prepared[0]
    term = one_term(prepared, "distances", loss="cauchy")
    states = np.asarray(a.grid.states)
    rows, _ = (np.asarray(part) for part in split_keys(np.asarray(a.keys)[: states.size]))
    is_near = np.asarray(a.keys)[: states.size] != NOTHING_NEAR
    is_signed = np.any(np.asarray(a.sides), axis=1)
    dense = np.full(states.size, 5 * VOXEL)
    cells = np.stack(np.unravel_index(np.arange(states.size), states.shape), axis=-1)
    centres = np.asarray(a.grid.origin, np.float64) + (cells + 0.5) * VOXEL
    anchors, normals = np.asarray(a.anchors, np.float64), np.asarray(a.normals, np.float64)
    for k in np.flatnonzero(is_near):
        row = rows[k]
        dense[k] = distance_from_plane(
            centres[k], anchors[row], normals[row], is_signed[row], VOXEL, 5 * VOXEL
        )
    dense = dense.reshape(states.shape)
    places = (moved(np.asarray(start, np.float64), term.sample.points) - np.asarray(a.grid.origin)) / VOXEL
    found = np.asarray(term.rows(start, LEVEL))
    assert found.shape == (1, 256)
    for k, place in enumerate(places):
        if np.abs(place - 0.5 - np.rint(place - 0.5)).min() < 1e-3:
            continue  # float32 may take the next cell
        distance = trilinear(dense, 5 * VOXEL, place)
        expected = loss_of((distance / 0.15) ** 2, "cauchy") / 256
        np.testing.assert_allclose(found[0, k] ** 2, expected, rtol=2e-3, atol=2e-6)


def test_occupancies_differ_by_nothing_one_or_two(prepared, start):
    a, b = prepared
    term = one_term(prepared, "occupancies")
    dense = np.asarray([0.0, -1.0, 1.0])[np.asarray(a.grid.states)]
    states_b = np.asarray(b.grid.states)
    origin_b = np.asarray(b.grid.origin, np.float64)
    found = np.asarray(term.rows(start, LEVEL))
    said = []
    for k, point in enumerate(np.asarray(term.sample.points, np.float64)):
        cell = np.floor((point - origin_b) / VOXEL).astype(int)
        said.append(1.0 if states_b[tuple(cell)] == 2 else -1.0)
        place = (moved(np.asarray(start, np.float64), point[None])[0] - np.asarray(a.grid.origin)) / VOXEL
        if np.abs(place - 0.5 - np.rint(place - 0.5)).min() < 1e-3:
            continue
        expected = (trilinear(dense, 0.0, place) - said[-1]) / 16
        np.testing.assert_allclose(found[0, k], expected, atol=1e-4)
    assert 64 < said.count(-1.0) < 192


def test_corner_pairs_and_the_prior_follow_their_definition(prepared, start):
    rng = np.random.default_rng(1)
    of_b, of_a = rng.normal(size=(2, 7, 3)).astype(np.float32)
    share = rng.uniform(0, 1, 7).astype(np.float32)
    rows = np.asarray(CornerPairs(of_a=of_a, of_b=of_b, share=share, loss="huber").rows(start, LEVEL))
    gap = moved(np.asarray(start, np.float64), of_b) - of_a
    expected = [
        w * loss_of(g @ g / 0.15**2, "huber") for w, g in zip(share, gap.astype(np.float64), strict=True)
    ]
    np.testing.assert_allclose((rows**2).sum(axis=0), expected, rtol=1e-4)

    centroid = jnp.asarray(prepared[1].centroid)
    tangent = jnp.asarray([0.1, -0.2, 0.3, 0.05, 0.02, -0.04], jnp.float32)
    root = jnp.asarray(rng.normal(size=(6, 6)), jnp.float32)
    there = move_about(start, centroid, tangent)
    np.testing.assert_allclose(tangent_between(start, there, centroid), tangent, atol=3e-6)
    np.testing.assert_allclose(
        Prior(start, centroid, root).rows(there, LEVEL)[:, 0], root @ tangent, atol=1e-4
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_inverse", [False, True])
def test_equations_equal_dense_ones(prepared, start, kind, is_inverse):
    """Slope of the cost by autodiff; matrix as the weighted products of dense Jacobians of the offsets."""
    maps, T = (prepared[::-1], rigid.inverse(start)) if is_inverse else (prepared, start)
    problem = pose_problem(*maps, residuals={kind: 1.0}, num_points=256, both_ways=True)
    term = problem.terms[1 if is_inverse else 0]
    held = term.holding(term.met(T))
    assert isinstance(held, PointTerm)
    centroid = jnp.asarray(problem.centroid)
    found = pose_equations([held], T, centroid, LEVEL)

    def cost(tangent):
        rows = held.rows(move_about(T, centroid, tangent), LEVEL)
        return 0.5 * jnp.sum(rows * rows, dtype=jnp.float32)

    def offsets(tangent):
        placed = held.placed(move_about(T, centroid, tangent), jnp.zeros(3, jnp.float32))
        return jnp.stack(list(held.offsets(placed.points, LEVEL)))

    zero = jnp.zeros(6, jnp.float32)
    offset, jacobian = offsets(zero), jax.jacfwd(offsets)(zero)
    slope = held.weights() * robust_slope(jnp.sum(offset * offset, axis=0, dtype=jnp.float32), held.loss)
    matrix = jnp.einsum("kni,knj,n->ij", jacobian, jacobian, slope)
    np.testing.assert_allclose(found.cost, cost(zero), rtol=1e-5)
    np.testing.assert_allclose(found.slope, jax.grad(cost)(zero), atol=2e-5 * float(jnp.abs(matrix).max()))
    np.testing.assert_allclose(found.matrix, matrix, atol=2e-5 * float(jnp.abs(matrix).max()))


@pytest.mark.parametrize("kind", KINDS)
def test_thinned_terms_weigh_as_much(prepared, start, kind):
    term = one_term(prepared, kind)
    thin = term.thinned(8)
    assert thin.sample.weights.shape == (32,)
    np.testing.assert_allclose(thin.sample.weights.sum(), term.sample.weights.sum(), rtol=1e-5)
    np.testing.assert_allclose(
        thin.rows(start, LEVEL)[:, 3] ** 2, 8 * term.rows(start, LEVEL)[:, 24] ** 2, rtol=1e-4
    )
