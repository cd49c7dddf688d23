"""A robot in a generated place: its way, its scans, taken when they are asked for, and its maps."""

from dataclasses import dataclass

import numpy as np

from ... import rigid
from ...grid import VoxelGrid
from ..camera import DepthCamera
from ..lidar import Lidar, Scan, take_scan
from ..mapping import build_map
from ..scene import Scene
from ..trajectory import draw_drift, pose_of
from .place import Place, resampled


@dataclass(frozen=True)
class Survey:
    """How a robot maps.

    Attributes:
        sensor: What it carries.
        voxel_size: Edge length of a voxel of its map [m].
        extent: Stretch of the way that it maps [m]; 0 for a single scan.
        drift: Standard deviation of the positions that the mapper believes in [m].
    """

    sensor: Lidar | DepthCamera
    voxel_size: float
    extent: float
    drift: float


class Visitor:
    """A robot on the whole way through a place, of which it will map a part."""

    def __init__(self, seed: list[int], place: Place, scene: Scene, survey: Survey) -> None:
        """Draw the poses.

        Args:
            seed: Source of chance; scans are the same in whatever order they are asked for.
            place: Where the way leads.
            scene: The place as the robot finds it.
            survey: How it maps.
        """
        self._seed, self._scene, self._survey = seed, scene, survey
        self._scans: dict[int, Scan] = {}
        self._clouds: dict[int, np.ndarray] = {}
        rng = np.random.default_rng([*seed, 0])
        self._poses = walk(rng, place, scene)
        self._believed = draw_drift(rng, self._poses, survey.drift)
        self.num_scans = min(1 + round(survey.extent / place.step), max(4 * len(self._poses) // 5, 1))
        """How many scans make its map."""

    def __len__(self) -> int:
        return len(self._poses)

    def scan(self, number: int) -> Scan:
        """The scan at a pose of the way."""
        if number not in self._scans:
            rng = np.random.default_rng([*self._seed, 1, number])
            self._scans[number] = take_scan(rng, self._scene, self._poses[number], self._survey.sensor)
        return self._scans[number]

    def cloud(self, numbers: range) -> np.ndarray:
        """Echoes (n, 3) [m] of scans where the robot believes them to be in the world, about one a voxel and scan."""
        for number in numbers:
            if number not in self._clouds:
                scan, T = self.scan(number), self._believed[number]
                points = scan.points[: scan.num_hits] @ T[:3, :3].T + T[:3, 3]
                self._clouds[number] = _thinned(points, self._survey.voxel_size)
        return _thinned(np.concatenate([self._clouds[n] for n in numbers]), self._survey.voxel_size)

    def map(self, numbers: range, T_world_map: np.ndarray, *, has_free_space: bool) -> VoxelGrid:
        """The map of scans in a frame; without free space it is made of the echoes alone, as a cloud."""
        poses = rigid.inverse(T_world_map) @ self._believed[numbers.start : numbers.stop]
        scans = [self.scan(number) for number in numbers]
        if has_free_space:
            return build_map(scans, poses, voxel_size=self._survey.voxel_size)
        points = [
            scan.points[: scan.num_hits] @ T[:3, :3].T + T[:3, 3]
            for scan, T in zip(scans, poses, strict=True)
        ]
        return VoxelGrid.from_points(np.concatenate(points), voxel_size=self._survey.voxel_size)


def walk(rng: np.random.Generator, place: Place, scene: Scene) -> np.ndarray:
    """Sensor poses (n, 4, 4) along the way of a place: beside it by some, there or back, where nothing stands.

    Args:
        rng: Source of chance.
        place: Whose way it is.
        scene: The place on that day.
    """
    way = resampled(place.path, place.step)
    ahead = np.gradient(way, axis=0)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    marks = place.step * np.arange(len(way))
    wave = 0.5 * np.sin(2.0 * np.pi * (marks / rng.uniform(15.0, 40.0) + rng.random())) + rng.uniform(
        -0.5, 0.5
    )
    way[:, 0] -= place.sway * wave * np.sin(yaw)
    way[:, 1] += place.sway * wave * np.cos(yaw)
    tilt = rng.normal(0.0, np.radians(1.0), (len(way), 2))
    if place.gaze is None:
        # Who comes the other way sees the same in another order.
        yaw += np.pi * rng.integers(2)
    else:
        look = 2.0 * np.pi * (marks / rng.uniform(2.0, 5.0) + rng.random())
        yaw += place.gaze + 0.4 * np.sin(look)
        tilt[:, 1] += rng.uniform(0.2, 0.4) + 0.15 * np.sin(1.7 * look)
    is_clear = scene.solids.distance(way).min(axis=1) > 0.25
    rows = zip(way[is_clear], tilt[is_clear], yaw[is_clear], strict=True)
    return np.asarray([pose_of(p, [a, b, c]) for p, (a, b), c in rows])


def _thinned(points: np.ndarray, size: float) -> np.ndarray:
    """The first point in each cell of that size."""
    index = np.floor(points / size).astype(np.int64)
    key = (index - index.min(axis=0, initial=0)) @ np.asarray([1 << 42, 1 << 21, 1], np.int64)
    return points[np.unique(key, return_index=True)[1]]
