"""A furnished room in several frames, and the problems between its maps."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import nudged, random_pose
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


CELLS, ROWS, BLOCKS = 1 << 18, 1 << 15, 1 << 10


@pytest.fixture(scope="session")
def small(prepared):
    """A function that cuts a problem's tables to little more than what is in them.

    Padded ones are too large to be stacked, or to be constants of a kernel.
    """
    for part in prepared:
        assert part.num_rows * 512 <= CELLS
        assert part.num_points <= ROWS
        assert part.num_blocks <= BLOCKS

    def cut(term):
        if isinstance(term, PointToPlane):
            surface = term.surface
            rows = {name: getattr(surface, name)[:ROWS] for name in ("points", "normals", "planarity")}
            assert surface.table is not None  # that of a prepared map
            rows |= {"keys": surface.keys[:CELLS], "table": surface.table[:BLOCKS]}
            return eqx.tree_at(lambda t: t.surface, term, surface._replace(**rows))
        field = term.field
        cut_field = field._replace(rows=field.rows[:CELLS], table=field.table[:BLOCKS])
        return eqx.tree_at(lambda t: t.field, term, cut_field)

    return lambda problem: PoseProblem(tuple(map(cut, problem.terms)), problem.centroid, problem.radius)


@pytest.fixture(scope="session")
def start(room, prepared):
    """A pose a little off, so that no residual vanishes."""
    return jnp.asarray(
        nudged(room[2], prepared[1].centroid, np.random.default_rng(0), metres=0.04, degrees=0.7), jnp.float32
    )


@pytest.fixture(scope="session")
def pair():
    """A room, the same room in another frame, the true pose, and the centroid of the second map."""
    a = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(3), metres=3, degrees=40)
    b = a.transformed(np.linalg.inv(T))
    return prepare_map(a), prepare_map(b), T, b.occupied_points().mean(axis=0)


@pytest.fixture(scope="session")
def starts(room, prepared):
    """Two near ones, one a kilometre away, one of NaN."""
    rng = np.random.default_rng(7)
    near = [nudged(room[2], prepared[1].centroid, rng, metres=0.05, degrees=0.5) for _ in range(2)]
    far = near[0] + np.asarray([[0, 0, 0, 1000.0]] * 3 + [[0, 0, 0, 0]])
    return np.stack([*near, far, np.full((4, 4), np.nan)]).astype(np.float32)


@pytest.fixture(scope="session")
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


@pytest.fixture(scope="session")
def grids(room):
    """A room in three frames, the first of which is the world."""
    T = random_pose(np.random.default_rng(5), metres=3, degrees=40)
    return [room[0], room[1], room[0].transformed(np.linalg.inv(T))], [np.eye(4), room[2], T]


@pytest.fixture(scope="session")
def maps(prepared, grids):
    return [*prepared, prepare_map(grids[0][2])]


@pytest.fixture(scope="session")
def truth(grids):
    return grids[1]
