"""Occupancies of points against the field, by its definition."""

import jax.numpy as jnp
import numpy as np

from oracles.motions import moved
from oracles.refinement import trilinear
from oracles.rooms import VOXEL
from refinement_problems import one_term
from voxjax.refinement.residuals.terms import Level

LEVEL = Level(jnp.float32(0.15), jnp.int32(0))


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
