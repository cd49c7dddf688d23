"""A furnished room in two frames, and the problems between the two maps."""

import equinox as eqx
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.residuals.planes import PointToPlane
from voxjax.refinement.solve.problem import PoseProblem


@pytest.fixture(scope="session")
def room():
    """Map a, map b, and the true pose of b in a."""
    a = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(3), metres=3, degrees=40)
    return a, a.transformed(np.linalg.inv(T)), T


@pytest.fixture(scope="session")
def prepared(room):
    return prepare_map(room[0]), prepare_map(room[1])


CELLS, ROWS = 1 << 18, 1 << 15


@pytest.fixture(scope="session")
def small(prepared):
    """A function that cuts a problem's tables to little more than what is in them.

    Padded ones are too large to be stacked, or to be constants of a kernel.
    """
    for part in prepared:
        assert part.grid.states.size <= CELLS
        assert part.num_points <= ROWS

    def cut(term):
        if isinstance(term, PointToPlane):
            surface = term.surface
            rows = {name: getattr(surface, name)[:ROWS] for name in ("points", "normals", "planarity")}
            return eqx.tree_at(lambda t: t.surface, term, surface._replace(keys=surface.keys[:CELLS], **rows))
        return eqx.tree_at(lambda t: t.field.rows, term, term.field.rows[:CELLS])

    return lambda problem: PoseProblem(tuple(map(cut, problem.terms)), problem.centroid, problem.radius)
