"""Streets: houses with doors, bays and balconies on both sides, parked cars, trees, lamps, a crossing."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .garage import car
from .place import Part, Place, box, moved
from .trees import make_tree


def make_street(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a street of 170 m that bends; cars are what changes.

    Args:
        style: Source of what streets of one town share: width, height and kind of the houses, trees.
        rng: Source of all else.
    """
    road, walk = float(style.uniform(6.0, 11.0)), float(style.uniform(2.0, 4.0))
    tall, wide = float(style.uniform(5.0, 12.0)), float(style.uniform(7.0, 13.0))
    gap, spacing = float(style.uniform(0.05, 0.35)), float(style.uniform(8.0, 25.0))
    length, parked = 170.0, float(rng.uniform(0.25, 0.75))
    crossing = rng.uniform((0.25, 0.6), (0.45, 0.8)) * length
    fixed: list[Part] = [
        box((0.5 * length, 0.0), (length + 60.0, road), (-0.5, 0.0), "floor"),
    ]
    pieces: list[tuple[list[Part], list[Part]]] = []
    for side in (-1.0, 1.0):
        kerb = side * 0.5 * road
        fixed.append(box((0.5 * length, kerb + side * 22.0), (length + 60.0, 44.0), (-0.5, 0.12), "floor"))
        fixed += _houses(rng, length, kerb + side * walk, side, crossing, (tall, wide, gap))
        for x in np.arange(2.0, length, spacing) + rng.uniform(
            -2.0, 2.0, len(np.arange(2.0, length, spacing))
        ):
            if rng.random() < 0.75 and np.abs(x - crossing).min() > 7.0:
                fixed += moved(_tree_or_lamp(rng), np.asarray([x, kerb + side * 0.9, 0.1]))
        for x in np.arange(2.0, length - 4.0, 5.6):
            if np.abs(x - crossing).min() > 8.0:
                at = np.asarray([x, kerb - side * 1.1, 0.0])
                pieces.append((_parked(rng, at, parked), _parked(rng, at, parked)))
    return _bent(rng, fixed, pieces, length)


def _bent(
    rng: np.random.Generator,
    fixed: list[Part],
    pieces: list[tuple[list[Part], list[Part]]],
    length: float,
) -> Place:
    """The straight street bent to both sides, up and down by the warp alone."""
    path = np.asarray([(x, 0.0, 1.9) for x in np.arange(0.0, length, 10.0)])
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=path,
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-24.0, 16.0, 32)),
            upright_beams=np.zeros(0),
            num_azimuths=360,
            max_range=32.0,
            free_range=10.0,
            range_noise=0.03,
            people=0.6,
        ),
        voxel_size=0.3,
        extent=(25.0, 60.0),
        step=3.5,
        sway=1.2,
        warp=draw_warp(rng, (0.25, 0.25, 0.4), (4.0, 90.0)),
    )


def _houses(
    rng: np.random.Generator,
    length: float,
    front: float,
    side: float,
    crossing: np.ndarray,
    style: tuple[float, float, float],
) -> list[Part]:
    """A row of houses along one side, with gaps, none where a street crosses."""
    tall, wide, gap = style
    parts, x = [], -20.0
    while x < length + 20.0:
        width = rng.uniform(0.6, 1.5) * wide
        middle = x + 0.5 * width
        if np.abs(middle - crossing).min() > 0.5 * width + 4.0 and rng.random() > gap:
            back = front + side * max(rng.normal(0.0, 1.0), -0.4)
            parts += moved(
                _house(rng, width, rng.uniform(0.6, 1.4) * tall, side), np.asarray([middle, back, 0.0])
            )
        elif rng.random() < 0.5:
            # A garden wall closes many a gap.
            parts.append(
                box((middle, front + side * 0.2), (0.8 * width, 0.25), (0.0, rng.uniform(0.8, 2.0)), "wall")
            )
        x += width + (rng.uniform(1.0, 5.0) if rng.random() < gap else 0.0)
    return parts


def _house(rng: np.random.Generator, width: float, height: float, side: float) -> list[Part]:
    """A house whose front lies at y = 0, its depth on `side` of it, with windows between piers."""
    deep = rng.uniform(8.0, 12.0)
    parts = [box((0.0, side * (0.25 + 0.5 * deep)), (width, deep), (0.0, height), "wall")]
    storey, pier = rng.uniform(2.8, 3.5), rng.uniform(0.8, 1.6)
    # Piers and sills stand out before the panes of the windows, which show no echo of their own.
    count = max(int(width / rng.uniform(2.2, 3.4)), 2)
    parts += [
        box((x, side * 0.125), (pier, 0.25), (0.0, height), "wall")
        for x in np.linspace(-0.5 * (width - pier), 0.5 * (width - pier), count)
    ]
    parts += [
        box((0.0, side * 0.125), (width, 0.25), (z - 0.45, min(z + 0.55, height)), "wall")
        for z in np.arange(storey, height, storey)
    ]
    for _ in range(rng.poisson(1.0)):
        x, z = rng.uniform(-0.35, 0.35) * width, storey * rng.integers(1, max(int(height / storey), 1) + 1)
        size = rng.uniform((1.5, 0.7), (3.0, 1.4))
        parts.append(box((x, -side * 0.5 * size[1]), (size[0], size[1]), (z - 0.15, z + 0.9), "wall"))
    if rng.random() < 0.6:
        x = rng.uniform(-0.3, 0.3) * width
        parts.append(
            box((x, -side * 0.35), (rng.uniform(1.2, 2.0), 0.7), (0.0, rng.uniform(0.15, 0.5)), "step")
        )
    return parts


def _tree_or_lamp(rng: np.random.Generator) -> list[Part]:
    """A tree of a street, or a lamp."""
    if rng.random() < 0.75:
        return make_tree(rng, height=float(rng.uniform(4.0, 9.0)), clear=float(rng.uniform(1.8, 3.0)))
    top = rng.uniform(4.5, 7.0)
    return [
        box((0.0, 0.0), (0.18, 0.18), (0.0, top), "lamp"),
        box((0.0, 0.0), (0.3, 1.2), (top - 0.15, top), "lamp"),
    ]


def _parked(rng: np.random.Generator, at: np.ndarray, chance: float) -> list[Part]:
    """A car at the kerb, or none."""
    if rng.random() >= chance:
        return []
    place = at + np.asarray([rng.uniform(-0.5, 0.5), rng.uniform(-0.15, 0.15), 0.0])
    return moved(car(rng), place, rng.uniform(-0.03, 0.03) + np.pi * (rng.random() < 0.5))
