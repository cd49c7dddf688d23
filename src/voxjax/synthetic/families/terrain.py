"""Valleys: rolling ground with houses and trees, mapped from the air.

Nothing in them is a room: what a search knows of walls and furniture was chosen on other kinds of places. Lengths
are of the world (houses of ten metres, hills of a hundred), so that the voxel size is what differs.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ... import rigid
from ...grid import VoxelGrid
from ..ground import Ground
from ..team import Frame, draw_frame
from ._types import FamilyMaps


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

    @property
    def length(self) -> float:
        """Extent along x of both maps together [m]."""
        return self.side * (2.0 - self.overlap)


def simulate_valley(seed: int, valley: Valley | None = None) -> FamilyMaps:
    """Two maps of a valley, turned about the vertical and by up to 5 degrees about the other axes.

    Args:
        seed: Same seed and valley, same maps.
        valley: None takes the default.
    """
    valley = Valley() if valley is None else valley
    rng = np.random.default_rng([seed, 1])
    ground = Ground(rng, max(valley.length, valley.side), valley.relief)
    solids = np.concatenate(_objects(rng, valley, ground))
    turn = Rotation.from_euler("zyx", rng.uniform([-180.0, -5.0, -5.0], [180.0, 5.0, 5.0]), degrees=True)
    T_a_b = np.eye(4)
    T_a_b[:3, :3], T_a_b[:3, 3] = turn.as_matrix(), rng.uniform(-200.0, 200.0, 3)
    grids = []
    for number, T in enumerate((np.eye(4), np.linalg.inv(T_a_b))):
        low = number * valley.side * (1.0 - valley.overlap)
        grids.append(_map(rng, valley, low, ground, solids, T))
    return FamilyMaps((grids[0], grids[1]), T_a_b)


def simulate_terrain(
    rng: np.random.Generator,
    *,
    overlap: float,
    changed: float,
    elsewhere: bool,
    frame: Frame,
    has_free_space: bool,
) -> FamilyMaps:
    """Two maps of a valley whose relief, houses and trees are drawn, or of two valleys of one kind.

    Args:
        rng: Source of chance.
        overlap: Share of the voxels of one map that lie on the other, about.
        changed: Share of the houses and trees that the second map has elsewhere.
        elsewhere: Whether the second map is of another valley.
        frame: How the maps' frames lie.
        has_free_space: Whether the maps know the air.
    """
    voxel_size = float(rng.uniform(0.5, 1.5))
    valley = Valley(
        side=float(rng.uniform(110.0, 150.0)) * voxel_size,
        # Noise puts some voxels of what both see beside those of the other map.
        overlap=min(1.1 * overlap, 1.0),
        relief=float(rng.uniform(3.0, 9.0)) * voxel_size,
        houses=float(rng.uniform(0.0, 400.0)),
        trees=float(rng.uniform(500.0, 5000.0)),
        voxel_size=voxel_size,
        noise=float(rng.uniform(0.1, 0.4)),
        has_free_space=has_free_space,
    )
    grounds = [Ground(rng, valley.length, valley.relief) for _ in range(1 + elsewhere)]
    days = [_objects(rng, valley, ground) for ground in (grounds[0], grounds[-1])]
    if not elsewhere:
        is_other = rng.random(len(days[0])) < changed
        days[1] = [new if is_new else old for old, new, is_new in zip(*days, is_other, strict=True)]
    frames = [draw_frame(rng, frame) for _ in days]
    a, b = (
        _map(rng, valley, low, ground, np.concatenate(objects), rigid.inverse(T))
        for low, ground, objects, T in zip(
            (0.0, valley.length - valley.side), (grounds[0], grounds[-1]), days, frames, strict=True
        )
    )
    return FamilyMaps((a, b), None if elsewhere else rigid.inverse(frames[0]) @ frames[1])


def _objects(rng: np.random.Generator, valley: Valley, ground: Ground) -> list[np.ndarray]:
    """Places (n, 3) [m] on walls and roofs of each house and on the crown of each tree, several a voxel."""
    area = valley.length * valley.side
    objects = [np.zeros((0, 3))]
    for number, draw in ((valley.houses, _house), (valley.trees, _crown)):
        for _ in range(round(number * area * 1e-6)):
            objects.append(draw(rng, valley, ground))
    return objects


def _house(rng: np.random.Generator, valley: Valley, ground: Ground) -> np.ndarray:
    """A house with a gable roof."""
    step = 0.5 * valley.voxel_size
    at, yaw = rng.uniform((0.0, 0.0), (valley.length, valley.side)), rng.uniform(-np.pi, np.pi)
    wide, deep, high = rng.uniform((8.0, 6.0, 4.0), (20.0, 12.0, 9.0))
    u, v = (np.arange(-0.5 * s, 0.5 * s + step, step) for s in (wide, deep))
    uu, vv = (g.reshape(-1) for g in np.meshgrid(u, v))
    roof = np.stack([uu, vv, high + 0.4 * deep - 0.8 * np.abs(vv)], axis=1)
    rim = (np.abs(uu) >= np.abs(u).max() - 1e-9) | (np.abs(vv) >= np.abs(v).max() - 1e-9)
    levels = np.arange(-3.0, high, step)
    foot = np.repeat(roof[rim, :2], len(levels), axis=0)
    walls = np.column_stack([foot, np.tile(levels, rim.sum())])
    house = np.concatenate([roof, walls]) @ Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix().T
    return house + [*at, float(ground.at(at[None])[0])]


def _crown(rng: np.random.Generator, valley: Valley, ground: Ground) -> np.ndarray:
    """A tree, a cone of leaves."""
    at, high = rng.uniform((0.0, 0.0), (valley.length, valley.side)), rng.uniform(4.0, 18.0)
    radius = 0.25 * high
    many = max(int(12.0 * radius * high / valley.voxel_size**2), 4)
    around, up = rng.uniform(-np.pi, np.pi, many), np.sqrt(rng.uniform(0.0, 1.0, many))
    crown = radius * up[:, None] * np.stack([np.cos(around), np.sin(around)], axis=1)
    return np.column_stack([crown, high * (1.0 - 0.7 * up)]) + [*at, float(ground.at(at[None])[0])]


def _map(
    rng: np.random.Generator,
    valley: Valley,
    low: float,
    ground: Ground,
    solids: np.ndarray,
    T_map_valley: np.ndarray,
) -> VoxelGrid:
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
    return VoxelGrid.from_points(
        points @ R + t,
        voxel_size=size,
        sensor_origins=sensors @ R + t if valley.has_free_space else None,
    )
