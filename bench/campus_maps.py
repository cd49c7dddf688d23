"""A generated campus in two Zarr stores: buildings, and terrain along roads, written shard by shard.

A few simulated buildings stand in many places and under several angles; each has two maps with noise, clutter and drift
of their own, one for either map of the campus. Terrain is seen where roads are, by each map with noise of its own, and
free space above it. No map is ever held whole, and no surface is invented where nothing was built: most of the box is
unknown, as in a survey.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import voxjax as vx
from voxjax.io.zarr_shards import SHARD
from voxjax.io.zarr_writing import MapStore
from voxjax.synthetic import simulate_team


@dataclass(frozen=True)
class Campus:
    """What a campus is made of.

    Attributes:
        shape: Voxels of its box along x, y, z.
        num_buildings: How many stand in it.
        num_kinds: How many different ones there are.
        num_roads: Roads along x, and as many along y.
        voxel_size: Edge length of a voxel [m].
    """

    shape: tuple[int, int, int]
    num_buildings: int
    num_kinds: int
    num_roads: int
    voxel_size: float = 0.1

    @property
    def sides(self) -> np.ndarray:
        """Extent along x, y, z [m]."""
        return np.asarray(self.shape) * self.voxel_size

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Where the ground lies [m]; buildings and their noise have 6 m above it."""
        most = self.sides[2] - 7.0
        waves = np.sin(x / 41.0) + np.cos(y / 57.0 + 0.5) + np.sin((x + 2 * y) / 83.0)
        return 0.5 + most * (waves + 3.0) / 6.0

    def off_road(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """How far places lie from the middle of the next road [m], by sides: roads wind, none like the other."""
        found = np.full(x.shape, np.inf)
        for number in range(self.num_roads):
            share = (number + 0.5 + 0.21 * np.sin(7.0 * number)) / self.num_roads
            for along, across, side in ((x, y, self.sides[1]), (y, x, self.sides[0])):
                bend = 9.0 * np.sin(along / (31.0 + 5 * number)) + 4.0 * np.cos(along / 13.0 + number)
                found = np.minimum(found, np.abs(across - share * side - bend))
        return found


def write_campus(seed: int, campus: Campus, folder: Path) -> np.ndarray:
    """Write the maps a.zarr and b.zarr, of which a has two thirds of the campus along x and b two thirds from the end.

    Args:
        seed: Same seed, same maps.
        campus: How large it is.
        folder: Where they go.

    Returns:
        The true pose of b in a, (4, 4).
    """
    rng = np.random.default_rng([seed, 9])
    # In frames of the maps, whole voxels apart: what is pasted keeps its lattice.
    T_a_b = _yaw_pose(rng.uniform(-np.pi, np.pi), campus.sides[0] / 3, 0.0, 0.0)
    places = _places(rng, campus)
    for which, T in enumerate((np.eye(4), T_a_b)):
        low, high = ((0.0, 2 / 3), (1 / 3, 1.0))[which]
        span = low * campus.sides[0], high * campus.sides[0]
        pieces = [
            _placed(seed, which, kind, yaw, place, T, campus.voxel_size)
            for kind, yaw, place in places
            if span[0] <= place[0] <= span[1]
        ]
        _write(
            np.random.default_rng([seed, 10 + which]), campus, pieces, T, span, folder / f"{'ab'[which]}.zarr"
        )
    return T_a_b


def _yaw_pose(angle: float, x: float, y: float, z: float) -> np.ndarray:
    """A pose that turns about the vertical by an angle [rad] and then moves [m]."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = x, y, z
    return T


def _places(rng: np.random.Generator, campus: Campus) -> list[tuple[int, float, np.ndarray]]:
    """Kind, yaw and place [m] of each building: one in a field of a chessboard, anywhere in it."""
    columns = max(round(np.sqrt(campus.num_buildings * campus.shape[0] / campus.shape[1])), 1)
    rows = -(-campus.num_buildings // columns)
    field = campus.sides[:2] / (columns, rows)
    found = []
    for number in range(campus.num_buildings):
        middle = (np.array(divmod(number, rows)) + 0.5) * field
        x, y = middle + rng.uniform(-0.5, 0.5, 2) * np.maximum(field - 50.0, 0.0)
        yaw = rng.integers(6) * np.pi / 3 + 0.2
        found.append((number % campus.num_kinds, yaw, np.array([x, y, campus.height(x, y)])))
    return found


def _placed(
    seed: int, which: int, kind: int, yaw: float, place: np.ndarray, T: np.ndarray, voxel_size: float
) -> tuple[np.ndarray, np.ndarray]:
    """A building in one of the maps: its lowest voxel on the map's lattice, and its states.

    Args:
        seed: Decides what the building is.
        which: 0 for map a, 1 for map b.
        kind: Which building.
        yaw: How it is turned on the campus [rad].
        place: Where it stands there [m].
        T: Pose of the map on the campus.
        voxel_size: Of both [m].
    """
    turn = yaw - np.arctan2(T[1, 0], T[0, 0])
    grid = _turned(seed, which, kind, round(turn, 9), voxel_size)
    at = np.linalg.inv(T) @ np.append(place, 1.0)
    # Rounded to whole voxels: a drift of some three centimetres along each axis.
    low = np.rint((np.asarray(grid.origin) + at[:3]) / voxel_size).astype(np.int64)
    return low, np.asarray(grid.states)


@functools.cache
def _turned(seed: int, which: int, kind: int, turn: float, voxel_size: float) -> vx.VoxelGrid:
    """A building, as one of the two maps knows it, about its own origin and turned."""
    team = _team(seed, kind, voxel_size)
    T = _yaw_pose(turn, 0.0, 0.0, 0.0) @ np.asarray(team.poses[which], np.float64)
    return team.grids[which].transformed(T).crop_to_known()


@functools.cache
def _team(seed: int, kind: int, voxel_size: float):
    """Two maps of one building."""
    number = int(np.random.SeedSequence([seed, kind]).generate_state(1)[0])
    return simulate_team(number, overlap=1.0, voxel_size=voxel_size)


def _write(
    rng: np.random.Generator,
    campus: Campus,
    pieces: list[tuple[np.ndarray, np.ndarray]],
    T: np.ndarray,
    span: tuple[float, float],
    path: Path,
) -> None:
    """Write one map, shard by shard, on the lattice of its own frame."""
    size = campus.voxel_size
    corners = [[x, y, z, 1.0] for x in span for y in (0.0, campus.sides[1]) for z in (0.0, campus.sides[2])]
    image = (np.linalg.inv(T) @ np.transpose(corners))[:3] / size
    low = np.floor(image.min(axis=1)).astype(np.int64)
    shape = np.ceil(image.max(axis=1)).astype(np.int64) - low
    shape[2] = campus.shape[2]
    store = MapStore.make(path, tuple(shape.tolist()), low * size, size, has_log_odds=False)
    for x, y in np.ndindex(*(-(-shape[:2] // SHARD))):
        # No campus is higher than a shard.
        place = np.array([x, y, 0])
        begin, end = store.shard_box(place)
        states = _roads(rng, campus, T, span, low + begin, end - begin)
        for at, values in pieces:
            _paste(states, at - low - begin, values)
        if states.any():
            store.write(place, _windows(begin, states))


def _roads(
    rng: np.random.Generator,
    campus: Campus,
    T: np.ndarray,
    span: tuple[float, float],
    low: np.ndarray,
    shape: np.ndarray,
) -> np.ndarray:
    """What a map knows of roads in a box of voxels: 5 m of ground, pieces of a wall, and free space above."""
    size, states = campus.voxel_size, np.zeros(shape, np.uint8)
    u, v = ((low[k] + np.arange(shape[k]) + 0.5) * size for k in range(2))
    x = T[0, 0] * u[:, None] + T[0, 1] * v + T[0, 3]
    y = T[1, 0] * u[:, None] + T[1, 1] * v + T[1, 3]
    off = campus.off_road(x, y)
    inside = (x >= span[0]) & (x < span[1]) & (y >= 0.0) & (y < campus.sides[1])
    at = np.nonzero((off < 2.5) & inside)
    ground = campus.height(x[at], y[at]) + rng.normal(scale=0.02, size=len(at[0]))
    bottom = np.clip(np.floor(ground / size).astype(np.int64) - low[2], 0, shape[2] - 1)
    # Where there is a wall at the rim and where a gap follows from the place alone, so that both maps agree.
    rim = (off[at] > 2.3) & (np.sin(x[at] / 5.1) + np.sin(y[at] / 3.7) > 0.3)
    wall = np.where(rim, 16, 1)
    for layer in range(24):
        z = bottom + layer
        ok = z < shape[2]
        states[at[0][ok], at[1][ok], z[ok]] = np.where(layer < wall[ok], 2, 1)
    return states


def _paste(states: np.ndarray, at: np.ndarray, values: np.ndarray) -> None:
    """Put a piece into a box, of which it may reach beyond; the greater of both states stays."""
    low, high = np.maximum(at, 0), np.minimum(at + values.shape, states.shape)
    if (high > low).all():
        box = tuple(map(slice, low, high))
        states[box] = np.maximum(states[box], values[tuple(map(slice, low - at, high - at))])


def _windows(begin: np.ndarray, states: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, None]]:
    """A shard as one window."""
    yield begin, states, None
