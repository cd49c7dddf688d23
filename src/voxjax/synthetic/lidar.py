"""A spinning 3D lidar in a generated world: beams, ranges, noise, drop-outs and people walking by."""

from dataclasses import dataclass, field, replace

import numpy as np

from .camera import DepthCamera
from .prisms import Prisms, join_prisms, make_prisms, rectangle
from .scene import Scene

_MAX_PEOPLE = 4


def _fan(half_angle: float) -> np.ndarray:
    """Elevations of 24 beams [rad], from `half_angle` [degrees] below to as much above."""
    return np.radians(np.linspace(-half_angle, half_angle, 24))


@dataclass(frozen=True)
class Lidar:
    """Two spinning heads: one about the vertical, one about the forward axis, which sees floor and ceiling.

    Attributes:
        level_beams: Elevations of the beams of the first head [rad].
        upright_beams: Likewise of the second head, measured from the plane across the way.
        num_azimuths: Shots of each beam a turn.
        max_range: Longest distance that is measured [m].
        free_range: A shot without echo is taken as free space up to here [m].
        range_noise: Standard deviation of the range [m].
        dropout: Share of the shots that are lost.
        people: Mean number of people near the sensor in a scan.
    """

    level_beams: np.ndarray = field(default_factory=lambda: _fan(25.0))
    upright_beams: np.ndarray = field(default_factory=lambda: _fan(50.0))
    num_azimuths: int = 320
    max_range: float = 18.0
    free_range: float = 5.0
    range_noise: float = 0.02
    dropout: float = 0.08
    people: float = 0.4

    def directions(self) -> np.ndarray:
        """Unit vectors (n, 3) in the sensor's frame: x ahead, z up."""
        level = self._turn(self.level_beams)
        # Coordinates moved on by one turn the axis of rotation from z to x, which is ahead.
        upright = np.roll(self._turn(self.upright_beams), 1, axis=1)
        return np.concatenate([level, upright])

    def noise_at(self, ranges: np.ndarray) -> np.ndarray:
        """Standard deviation of each range (n,) [m]: the same for all."""
        return np.full(len(ranges), self.range_noise)

    def _turn(self, elevations: np.ndarray) -> np.ndarray:
        """Shots of one turn about z; neighbouring beams are shifted by half a step."""
        azimuth = 2.0 * np.pi * np.arange(self.num_azimuths) / self.num_azimuths
        # Beams whose shots lie between those of the next ones leave smaller gaps on a wall.
        shift = np.pi / self.num_azimuths * (np.arange(len(elevations)) % 2)
        angle = azimuth[:, None] + shift[None, :]
        elevation = np.broadcast_to(elevations, angle.shape)
        rows = [np.cos(elevation) * np.cos(angle), np.cos(elevation) * np.sin(angle), np.sin(elevation)]
        return np.stack(rows, axis=-1).reshape(-1, 3)


@dataclass(frozen=True)
class Scan:
    """One turn of the lidar, in the sensor's frame.

    Attributes:
        points: (n, 3) [m]: echoes, then the ends of the free shots.
        num_hits: How many of them are echoes.
    """

    points: np.ndarray
    num_hits: int


def take_scan(
    rng: np.random.Generator, scene: Scene, T_world_sensor: np.ndarray, sensor: Lidar | DepthCamera
) -> Scan:
    """Scan the scene, and people, from a pose.

    Args:
        rng: Source of chance.
        scene: What is seen.
        T_world_sensor: (4, 4) true pose.
        sensor: The lidar or camera.
    """
    shots, R = sensor.directions(), T_world_sensor[:3, :3]
    solids = join_prisms(scene.solids, _draw_people(rng, T_world_sensor[:3, 3], sensor.people))
    crowded = replace(scene, solids=solids)
    ranges = crowded.ranges(T_world_sensor[:3, 3], shots @ R.T, sensor.max_range)
    # Beyond the longest range there is no echo, whether something stands there or not.
    is_echo = ranges <= sensor.max_range
    # Noise and losses are drawn for all shots, so that the number of draws does not depend on what is seen.
    noisy = ranges + rng.normal(0.0, 1.0, len(ranges)) * sensor.noise_at(ranges)
    is_kept = rng.random(len(ranges)) >= sensor.dropout
    echoes = shots[is_echo & is_kept] * noisy[is_echo & is_kept, None]
    if scene.warp is not None:
        # What bends is the world: its points are moved the same way from wherever they are seen.
        echoes = echoes + scene.warp(echoes @ R.T + T_world_sensor[:3, 3]) @ R
    return Scan(np.concatenate([echoes, sensor.free_range * shots[~is_echo & is_kept]]), len(echoes))


def _draw_people(rng: np.random.Generator, near: np.ndarray, mean: float) -> Prisms:
    """People 0.8 to 4 m away from the sensor; some are behind walls, where nobody sees them."""
    parts = []
    for _ in range(min(rng.poisson(mean), _MAX_PEOPLE)):
        angle, distance = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.8, 4.0)
        centre = near[:2] + distance * np.asarray([np.cos(angle), np.sin(angle)])
        size = rng.uniform((0.4, 0.22), (0.55, 0.35))
        footprint = rectangle(centre, size[0], size[1], rng.uniform(0.0, np.pi))
        parts.append((footprint, 0.0, rng.uniform(1.55, 1.9), "person"))
    return make_prisms(parts)
