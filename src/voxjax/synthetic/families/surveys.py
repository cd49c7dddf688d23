"""How two robots map a place: alike, by single scans, a part of what the other maps, or with different sensors."""

from dataclasses import replace

import numpy as np

from ..camera import DepthCamera
from ..lidar import Lidar
from .place import Place
from .visitor import Survey


def alike(rng: np.random.Generator, place: Place) -> tuple[Survey, Survey]:
    """Two robots with the sensor of the place, of different noise, who go unlike ways."""
    voxel_size = _draw_size(rng, place)
    first, second = (_survey(rng, place, place.sensor, voxel_size) for _ in range(2))
    return first, second


def single_scans(rng: np.random.Generator, place: Place) -> tuple[Survey, Survey]:
    """Single scans of a sensor of sixteen beams: two of them, or one and a map of many."""
    voxel_size = _draw_size(rng, place) * float(rng.uniform(1.0, 1.4))
    sparse = _spinning(place, 16, 15.0, 900)
    scan = replace(_survey(rng, place, sparse, voxel_size), extent=0.0)
    if rng.random() < 0.5:
        return scan, replace(_survey(rng, place, sparse, voxel_size), extent=0.0)
    many = _survey(rng, place, place.sensor, voxel_size)
    return (many, scan) if rng.random() < 0.5 else (scan, many)


def part_of_many(rng: np.random.Generator, place: Place) -> tuple[Survey, Survey]:
    """A short way and one that is several times as long, with the sensor of the place."""
    first, second = alike(rng, place)
    long = replace(first, extent=float(rng.uniform(1.3, 1.9)) * place.extent[1])
    short = replace(second, extent=float(rng.uniform(0.4, 1.0)) * place.extent[0])
    return (long, short) if rng.random() < 0.5 else (short, long)


def unlike(rng: np.random.Generator, place: Place) -> tuple[Survey, Survey]:
    """The sensor of the place and another one, whose map has voxels of another size."""
    voxel_size = _draw_size(rng, place)
    others = (
        _spinning(place, 16, 15.0, 500),
        _spinning(place, 32, 22.0, 300),
        DepthCamera((80.0, 70.0), (100, 80), 0.8 * place.sensor.max_range, 0.0, 0.0008, 0.05),
    )
    other = others[int(rng.integers(len(others)))]
    first = _survey(rng, place, place.sensor, voxel_size)
    second = _survey(rng, place, other, voxel_size * float(rng.uniform(1.2, 2.0)))
    return (first, second) if rng.random() < 0.5 else (second, first)


def _draw_size(rng: np.random.Generator, place: Place) -> float:
    """A voxel size near the one that suits the place [m]."""
    return round(float(rng.uniform(0.85, 1.25)) * place.voxel_size, 3)


def _spinning(place: Place, beams: int, half_angle: float, azimuths: int) -> Lidar:
    """A lidar of one head that spins about the vertical and reaches as far as the sensor of the place."""
    return Lidar(
        level_beams=np.radians(np.linspace(-half_angle, half_angle, beams)),
        upright_beams=np.zeros(0),
        num_azimuths=azimuths,
        max_range=1.25 * place.sensor.max_range,
        free_range=place.sensor.free_range,
        people=place.sensor.people,
    )


def _survey(rng: np.random.Generator, place: Place, sensor: Lidar | DepthCamera, voxel_size: float) -> Survey:
    """How noisy the sensor of a robot is, how far it goes, and how well it knows where it is."""
    noisy = replace(sensor, range_noise=sensor.range_noise * float(rng.uniform(0.6, 1.5)))
    # Robots with coarse voxels know where they are as well as those with fine ones.
    drift = min(float(rng.uniform(0.1, 0.5)) * place.voxel_size, 0.06)
    return Survey(noisy, round(voxel_size, 3), float(rng.uniform(*place.extent)), drift)
