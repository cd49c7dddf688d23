"""Stairwells: equal flights and landings one above the other, doors to corridors that differ."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, moved


def make_stairwell(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a stairwell of six storeys; what stands on landings and in corridors changes.

    Args:
        style: Source of what stairwells of one builder share: width, rise and number of the steps.
        rng: Source of all else.
    """
    flight, steps = float(style.uniform(1.1, 1.5)), int(style.integers(8, 11))
    rise, tread = float(style.uniform(0.155, 0.18)), 0.28
    landing = float(style.uniform(1.3, 1.8))
    run, storey = steps * tread, 2 * steps * rise
    floors = 6
    # The eye between the two flights is as wide as a hand or as a man.
    width, length = 2.0 * flight + float(style.uniform(0.15, 0.9)), run + 2.0 * landing
    fixed, pieces = [], []
    for floor in range(floors):
        z = floor * storey
        parts = _flights(width, flight, landing, run, steps, rise) if floor < floors - 1 else []
        fixed += moved([*parts, *_shaft(rng, width, length, landing, storey)], np.asarray([0.0, 0.0, z]))
        pieces += [(_things(rng, z), _things(rng, z)) for _ in range(2)]
    fixed.append(box((0.5 * width, 0.5 * length), (width + 4.0, length + 12.0), (-0.3, 0.0), "floor"))
    fixed.append(
        box(
            (0.5 * width, 0.5 * length),
            (width + 4.0, length + 12.0),
            (floors * storey, floors * storey + 0.3),
            "ceiling",
        )
    )
    path = _climb(
        floors, storey, (0.5 * flight, width - 0.5 * flight), (0.6 * landing, length - 0.6 * landing)
    )
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=path + np.asarray([0.0, 0.0, rng.uniform(1.2, 1.6)]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-30.0, 30.0, 16)),
            upright_beams=np.radians(np.linspace(-50.0, 50.0, 16)),
            num_azimuths=200,
            max_range=9.0,
            people=0.0,
        ),
        voxel_size=0.08,
        extent=(16.0, 32.0),
        step=0.9,
        sway=0.12,
        warp=draw_warp(rng, 0.01, (1.0, 10.0)),
    )


def _climb(floors: int, storey: float, sides: tuple[float, float], ends: tuple[float, float]) -> np.ndarray:
    """Corners (n, 3) of the way up: over the landing, up one flight, over the next landing, up the other."""
    (left, right), (near, far) = sides, ends
    round_ = [(right, near, 0.0), (left, near, 0.0), (left, far, 0.5), (right, far, 0.5), (right, near, 1.0)]
    corners = [
        (x, y, floor * storey + share * storey) for floor in range(floors - 1) for x, y, share in round_
    ]
    top = [(x, y, (floors - 1) * storey) for x, y, _ in round_[:2]]
    return np.asarray(corners + top)


def _flights(width: float, flight: float, landing: float, run: float, steps: int, rise: float) -> list[Part]:
    """Two flights with the landing between them, and a rail on each."""
    tread, half = run / steps, steps * rise
    parts = []
    for k in range(steps):
        up, back = landing + (k + 0.5) * tread, landing + run - (k + 0.5) * tread
        parts.append(box((0.5 * flight, up), (flight, tread), (k * rise - 0.1, (k + 1) * rise), "step"))
        parts.append(
            box(
                (width - 0.5 * flight, back),
                (flight, tread),
                (half + k * rise - 0.1, half + (k + 1) * rise),
                "step",
            )
        )
        if k % 2 == 0:
            z = (k + 1) * rise
            parts.append(box((flight, up), (0.05, 0.05), (z, z + 0.95), "rail"))
            parts.append(box((width - flight, back), (0.05, 0.05), (half + z, half + z + 0.95), "rail"))
    far = landing + run + 0.5 * landing
    parts.append(box((0.5 * width, far), (width, landing), (half - 0.2, half), "floor"))
    return parts


def _shaft(
    rng: np.random.Generator, width: float, length: float, landing: float, storey: float
) -> list[Part]:
    """Walls of a storey, its landing, and a door that leads into a short corridor or is shut."""
    door, heights = float(rng.uniform(0.25, 0.75)) * width, (0.0, storey)
    parts = [box((x, 0.5 * length), (0.2, length + 0.4), heights, "wall") for x in (-0.1, width + 0.1)]
    parts.append(box((0.5 * width, length + 0.1), (width + 0.4, 0.2), heights, "wall"))
    for low, high in ((-0.2, door - 0.5), (door + 0.5, width + 0.2)):
        parts.append(box((0.5 * (low + high), -0.1), (high - low, 0.2), heights, "wall"))
    parts.append(box((door, -0.1), (1.0, 0.2), (2.05, storey), "wall"))
    parts.append(box((0.5 * width, 0.5 * landing), (width, landing), (-0.2, 0.0), "floor"))
    if rng.random() < 0.4:
        return [*parts, box((door, -0.12), (1.0, 0.06), (0.0, 2.05), "door")]
    deep = float(rng.uniform(1.5, 5.0))
    parts += [box((door + s * 1.0, -0.2 - 0.5 * deep), (0.2, deep), heights, "wall") for s in (-1.0, 1.0)]
    parts.append(box((door, -0.3 - deep), (2.4, 0.2), heights, "wall"))
    parts.append(box((door, -0.2 - 0.5 * deep), (2.4, deep), (-0.2, 0.0), "floor"))
    return [*parts, box((door, -0.2 - 0.5 * deep), (2.4, deep), (storey - 0.5, storey - 0.2), "ceiling")]


def _things(rng: np.random.Generator, z: float) -> list[Part]:
    """A plant, a bicycle, a box on the landing at height z, or nothing."""
    if rng.random() < 0.4:
        return []
    size = rng.uniform((0.25, 0.25, 0.4), (0.7, 0.45, 1.3))
    centre = (rng.uniform(0.3, 1.8), rng.uniform(0.25, 0.45))
    return [box(centre, (size[0], size[1]), (z, z + size[2]), "thing", rng.uniform(-0.4, 0.4))]
