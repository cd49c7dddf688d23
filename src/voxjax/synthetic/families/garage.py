"""Parking garages: equal floors of pillars and parapets, joined by ramps, and cars that come and go."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, moved

_SLAB = 0.4
"""Thickness of the floors [m]."""


def make_garage(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a garage of three floors; cars are what changes from day to day.

    Args:
        style: Source of what garages of one builder share: grid of pillars, height of the floors.
        rng: Source of all else.
    """
    bay, height = float(style.uniform(7.4, 8.2)), float(style.uniform(2.7, 3.1))
    stall, beams = 2.5, bool(style.random() < 0.5)
    length = float(rng.integers(5, 8)) * bay
    width, occupied = 33.0, float(rng.uniform(0.3, 0.8))
    floors = 3
    core = rng.uniform((0.2 * length, 3.0), (0.8 * length, 5.0))
    fixed, pieces = [], []
    for floor in range(floors):
        z = floor * (height + _SLAB)
        fixed += moved(
            _floor(length, width, height, bay, beams, core, floor, floors), np.asarray([0.0, 0.0, z])
        )
        # Lanes cross between the two middle rows, which are shorter.
        for y, yaw, first, last in (
            (2.6, 0.5, 0.3, length - 5.0),
            (13.8, -0.5, 6.6, length - 9.5),
            (19.2, 0.5, 6.6, length - 9.5),
            (30.4, -0.5, 0.3, length - 5.0),
        ):
            for x in np.arange(first, last - stall, stall):
                at = np.asarray([x + 0.5 * stall, y, z])
                pieces.append((_car(rng, at, yaw * np.pi, occupied), _car(rng, at, yaw * np.pi, occupied)))
    path = _path(length, height + _SLAB, floors)
    path[:, 2] += rng.uniform(1.2, 1.9)
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=path,
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-18.0, 18.0, 20)),
            upright_beams=np.radians(np.linspace(-40.0, 40.0, 8)),
            num_azimuths=280,
            max_range=20.0,
            people=0.0,
        ),
        voxel_size=0.2,
        extent=(35.0, 70.0),
        step=3.0,
        sway=0.5,
        warp=draw_warp(rng, 0.015, (2.0, 20.0)),
    )


def _floor(
    length: float,
    width: float,
    height: float,
    bay: float,
    beams: bool,
    core: np.ndarray,
    floor: int,
    floors: int,
) -> list[Part]:
    """One floor at z = 0: slab with the mouth of the ramp, pillars, parapets, the core of the stairs, the ramp."""
    top, half = height + _SLAB, 0.5 * width
    # The ramp lies along the end at x = length, and leads up from y = 6.5 to y = width - 6.5.
    mouth = (length - 4.5, length)
    parts = [box((0.5 * mouth[0], half), (mouth[0], width), (-_SLAB, 0.0), "floor")]
    ends = ((0.0, 6.5), (width - 6.5, width)) if floor else ((0.0, width),)
    parts += [box((sum(mouth) / 2, sum(y) / 2), (4.5, y[1] - y[0]), (-_SLAB, 0.0), "floor") for y in ends]
    if floor == floors - 1:
        parts.append(box((0.5 * length, half), (length, width), (height, top), "ceiling"))
    else:
        steps = np.linspace(6.5, width - 6.5, 21)
        rises = np.linspace(0.0, top, 21)
        parts += [
            box((sum(mouth) / 2, 0.5 * (a + b)), (4.3, b - a), (z - _SLAB, z), "floor")
            for a, b, z in zip(steps[:-1], steps[1:], rises[1:], strict=True)
        ]
    for x in np.arange(0.5 * bay, mouth[0], bay):
        for y in (5.3, 11.2, half, width - 11.2, width - 5.3):
            parts.append(box((x, y), (0.45, 0.45), (0.0, height), "wall"))
        if beams:
            parts.append(box((x, half), (0.3, width), (height - 0.4, height), "beam"))
    # The long side at y = 0 is a wall, the others are parapets under open air.
    parts.append(box((0.5 * length, -0.1), (length + 0.4, 0.2), (0.0, height), "wall"))
    parts.append(box((0.5 * length, width + 0.1), (length + 0.4, 0.2), (0.0, 1.1), "wall"))
    parts += [box((x, half), (0.2, width), (0.0, 1.1), "wall") for x in (-0.1, length + 0.1)]
    parts.append(box((core[0], core[1] - 1.5), (3.2, 3.0), (0.0, height), "wall"))
    return parts


def _path(length: float, rise: float, floors: int) -> np.ndarray:
    """One loop on each floor, and the ramp to the next."""
    loop = [(length - 2.2, 8.2), (4.0, 8.2), (4.0, 24.8), (length - 7.0, 24.8), (length - 7.0, 8.2)]
    corners = []
    for floor in range(floors):
        z = floor * rise
        # A robot comes off the ramp at its upper end, drives the loop, and goes to its lower end.
        corners += [(length - 2.2, 28.5, z)] if floor else []
        corners += [(length - 7.0, 24.8, z)] if floor else []
        corners += [(x, y, z) for x, y in (loop[1:] if floor else loop)]
        corners += [(length - 2.2, 4.0, z), (length - 2.2, 6.5, z)] if floor < floors - 1 else []
        corners += [(length - 2.2, 26.5, z + rise)] if floor < floors - 1 else []
    return np.asarray(corners)


def _car(rng: np.random.Generator, at: np.ndarray, yaw: float, chance: float) -> list[Part]:
    """A parked car, roughly in the middle of its place, or none."""
    if rng.random() >= chance:
        return []
    place = at + np.asarray([*rng.uniform(-0.15, 0.15, 2), 0.0])
    return moved(car(rng), place, yaw + rng.uniform(-0.05, 0.05) + np.pi * (rng.random() < 0.4))


def car(rng: np.random.Generator) -> list[Part]:
    """A car at the origin that heads along x: body and cabin, or a van."""
    length, width = rng.uniform(3.7, 4.9), rng.uniform(1.65, 1.9)
    if rng.random() < 0.15:
        return [box((0.0, 0.0), (length + 0.4, width + 0.1), (0.25, rng.uniform(1.9, 2.2)), "car")]
    body, roof = rng.uniform(0.8, 1.0), rng.uniform(1.4, 1.75)
    cabin = rng.uniform(0.45, 0.65) * length
    shift = -rng.uniform(0.0, 0.12) * length
    return [
        box((0.0, 0.0), (length, width), (0.2, body), "car"),
        box((shift, 0.0), (cabin, width - 0.25), (body, roof), "car"),
    ]
