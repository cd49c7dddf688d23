"""Distances of points against the pieces of plane that they are made of."""

import jax.numpy as jnp
import numpy as np

from near_fields import dense_values
from oracles.motions import moved
from oracles.refinement import distance_from_plane, loss_of, trilinear
from oracles.rooms import VOXEL
from refinement_problems import one_term
from voxjax.ops.evidence.nearest import NOTHING_NEAR, split_keys
from voxjax.refinement.residuals.terms import Level

LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


def test_distances_are_those_of_the_pieces_of_plane_read_between_centres(prepared, start):
    a = prepared[0]
    term = one_term(prepared, "distances", loss="cauchy")
    states = np.asarray(a.grid.states)
    keys = dense_values(a, a.keys).reshape(-1)
    rows, is_near = np.asarray(split_keys(keys)[0]), keys != NOTHING_NEAR
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
