"""Generated valleys: rolling ground with houses and trees, as two maps from the air that share a part.

Nothing in them is a room: what the search knows of walls and furniture was chosen on other kinds of places. Lengths
are of the world (houses of ten metres, hills of a hundred), so that the voxel size is what differs.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.worlds import MapPair
from voxjax.metrics import pose_error


@dataclass(frozen=True)
class Valley:
    """What a valley is made of.

    Attributes:
        side: Extent of each map along x and y [m].
        overlap: Share of a map's extent along x that both see.
        relief: Standard deviation of the ground's height [m].
        houses: Houses a square kilometre.
        trees: Trees a square kilometre.
        voxel_size: Edge length of a voxel [m].
        noise: Standard deviation of a point [voxel], and of how far a map is bent over its extent.
        has_free_space: Whether the maps were made with the places of the sensor, above the ground.
    """

    side: float = 500.0
    overlap: float = 0.5
    relief: float = 15.0
    houses: float = 150.0
    trees: float = 4000.0
    voxel_size: float = 1.0
    noise: float = 0.3
    has_free_space: bool = True


def simulate_valley(seed: int, valley: Valley | None = None) -> MapPair:
    """Two maps of a valley.

    Args:
        seed: Same seed and valley, same maps.
        valley: None takes the default.
    """
    valley = Valley() if valley is None else valley
    rng = np.random.default_rng([seed, 1])
    length = valley.side * (2.0 - valley.overlap)
    ground = _Ground(rng, max(length, valley.side), valley.relief)
    solids = _solids(rng, valley, length, ground)
    turn = Rotation.from_euler("zyx", rng.uniform([-180.0, -5.0, -5.0], [180.0, 5.0, 5.0]), degrees=True)
    T_a_b = np.eye(4)
    T_a_b[:3, :3], T_a_b[:3, 3] = turn.as_matrix(), rng.uniform(-200.0, 200.0, 3)
    grids = []
    for number, T in enumerate((np.eye(4), np.linalg.inv(T_a_b))):
        low = number * valley.side * (1.0 - valley.overlap)
        grids.append(_map(rng, valley, low, ground, solids, T))
    return MapPair(grids[0], grids[1], T_a_b, overlap=valley.overlap)


def valley_rows(seed: int, sizes: tuple[float, ...] = (0.5, 1.0, 2.0), *, width: int = 300) -> Iterator[dict]:
    """Verdicts, errors and seconds of valleys of one number of voxels, with and without free space.

    Args:
        seed: Same seed, same maps.
        sizes: Edge lengths of the voxels [m].
        width: Voxels along x and y.
    """
    for voxel_size in sizes:
        for has_free_space in (True, False):
            pair = simulate_valley(
                seed, Valley(side=width * voxel_size, voxel_size=voxel_size, has_free_space=has_free_space)
            )
            for _ in range(2):
                start = time.perf_counter()
                found = vx.register(pair.a, pair.b)
                seconds = time.perf_counter() - start
            error = pose_error(np.asarray(found.T_a_b), np.asarray(pair.T_a_b), pair.centroid_of_b)
            yield {
                "voxel [m]": voxel_size,
                "side [m]": width * voxel_size,
                "free space": "from the air" if has_free_space else "none",
                "occupied": f"{pair.a.num_occupied} / {pair.b.num_occupied}",
                "verdict": found.verdict,
                "confidence": found.confidence,
                "error [voxel]": error.metres / voxel_size,
                "error [deg]": error.degrees,
                "seconds": seconds,
            }


class _Ground:
    """Height of the ground over a square: noise whose amplitude falls with the frequency, as hills and ditches do."""

    def __init__(self, rng: np.random.Generator, side: float, relief: float) -> None:
        """Draw it on a lattice of two metres.

        Args:
            rng: What is drawn from.
            side: Side of the square [m].
            relief: Standard deviation of the height [m].
        """
        self._step = 2.0
        count = int(np.ceil(side / self._step)) + 2
        frequency = np.hypot(np.fft.fftfreq(count)[:, None], np.fft.rfftfreq(count)[None, :])
        frequency[0, 0] = np.inf
        wave = rng.normal(size=(count, count))
        self._height = np.fft.irfft2(np.fft.rfft2(wave) * frequency**-2.0, s=(count, count))
        self._height *= relief / self._height.std()

    def at(self, places: np.ndarray) -> np.ndarray:
        """Height [m] at places (n, 2) [m]."""
        return map_coordinates(self._height, (places / self._step).T, order=1, mode="nearest")


def _solids(rng: np.random.Generator, valley: Valley, length: float, ground: _Ground) -> np.ndarray:
    """Places (n, 3) [m] on walls and roofs of houses and on the crowns of trees, several a voxel."""
    area = length * valley.side
    step = 0.5 * valley.voxel_size
    points = []
    for _ in range(round(valley.houses * area * 1e-6)):
        at, yaw = rng.uniform((0.0, 0.0), (length, valley.side)), rng.uniform(-np.pi, np.pi)
        wide, deep, high = rng.uniform((8.0, 6.0, 4.0), (20.0, 12.0, 9.0))
        u, v = (np.arange(-0.5 * s, 0.5 * s + step, step) for s in (wide, deep))
        uu, vv = (g.reshape(-1) for g in np.meshgrid(u, v))
        # A gable roof.
        roof = np.stack([uu, vv, high + 0.4 * deep - 0.8 * np.abs(vv)], axis=1)
        rim = (np.abs(uu) >= np.abs(u).max() - 1e-9) | (np.abs(vv) >= np.abs(v).max() - 1e-9)
        levels = np.arange(-3.0, high, step)
        foot = np.repeat(roof[rim, :2], len(levels), axis=0)
        walls = np.column_stack([foot, np.tile(levels, rim.sum())])
        house = np.concatenate([roof, walls]) @ Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix().T
        points.append(house + [*at, float(ground.at(at[None])[0])])
    for _ in range(round(valley.trees * area * 1e-6)):
        at, high = rng.uniform((0.0, 0.0), (length, valley.side)), rng.uniform(4.0, 18.0)
        radius = 0.25 * high
        many = max(int(12.0 * radius * high / valley.voxel_size**2), 4)
        around, up = rng.uniform(-np.pi, np.pi, many), np.sqrt(rng.uniform(0.0, 1.0, many))
        crown = radius * up[:, None] * np.stack([np.cos(around), np.sin(around)], axis=1)
        points.append(
            np.column_stack([crown, high * (1.0 - 0.7 * up)]) + [*at, float(ground.at(at[None])[0])]
        )
    return np.concatenate(points)


def _map(
    rng: np.random.Generator,
    valley: Valley,
    low: float,
    ground: _Ground,
    solids: np.ndarray,
    T_map_valley: np.ndarray,
) -> vx.VoxelGrid:
    """What a sensor in the air sees of a part of the valley, from `low` along x on."""
    size = valley.voxel_size
    count = int(4.0 * (valley.side / size) ** 2)
    flat = rng.uniform((low, 0.0), (low + valley.side, valley.side), (count, 2))
    seen = solids[(solids[:, 0] >= low) & (solids[:, 0] <= low + valley.side)]
    points = np.concatenate([np.column_stack([flat, ground.at(flat)]), seen])
    # Drift bends a map by about as much as a point is off.
    phase = 2.0 * np.pi * (points[:, :2] / valley.side + rng.uniform(0.0, 1.0, 2))
    bend = np.column_stack([np.sin(phase), np.sin(phase.sum(axis=1))]) * valley.noise * size
    sensors = np.column_stack(
        [np.rint(points[:, :2] / 40.0) * 40.0, np.full(len(points), 4.0 * valley.relief + 60.0)]
    )
    points = points + bend + rng.normal(scale=valley.noise * size, size=points.shape)
    R, t = T_map_valley[:3, :3].T, T_map_valley[:3, 3]
    return vx.VoxelGrid.from_points(
        points @ R + t,
        voxel_size=size,
        sensor_origins=sensors @ R + t if valley.has_free_space else None,
    )
