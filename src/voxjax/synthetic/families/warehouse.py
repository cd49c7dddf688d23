"""Warehouses: equal racks in rows, pallets with boxes on their boards, columns, goods on the floor."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, serpentine


def make_warehouse(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a hall with racks; goods are what changes from day to day.

    Args:
        style: Source of what halls of one company share: racks, aisles, height.
        rng: Source of all else.
    """
    aisle, bay, depth = float(style.uniform(2.6, 3.6)), float(style.uniform(2.4, 3.0)), 1.1
    levels, level = int(style.integers(2, 4)), float(style.uniform(1.5, 1.9))
    height, filled = levels * level + float(style.uniform(2.0, 3.0)), float(style.uniform(0.55, 0.9))
    rows, bays = int(rng.integers(4, 7)), int(rng.integers(7, 11))
    margin = float(rng.uniform(3.0, 5.0))
    pitch = aisle + 2.0 * depth
    length, width = bays * bay + 2.0 * margin, rows * pitch + aisle
    fixed, pieces = _hall(rng, length, width, height), []
    for row in range(rows):
        # Two racks stand back to back.
        for side in (-0.5, 0.5):
            y = aisle + depth + row * pitch + side * depth
            fixed += _rack(margin, y, bays, bay, depth, levels, level)
            places = [(margin + (k + 0.5) * bay, y) for k in range(bays)]
            pieces += [
                (
                    _pallets(rng, at, bay, z * level, level, filled),
                    _pallets(rng, at, bay, z * level, level, filled),
                )
                for at in places
                for z in range(levels)
            ]
    pieces += [(_goods(rng, length, margin, width), _goods(rng, length, margin, width)) for _ in range(8)]
    aisles = [0.5 * aisle + row * pitch for row in range(rows + 1)]
    path = serpentine(aisles, (0.5 * margin, length - 0.5 * margin))
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=np.column_stack([path, np.full(len(path), rng.uniform(1.2, 2.0))]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-20.0, 20.0, 16)),
            upright_beams=np.radians(np.linspace(-50.0, 50.0, 16)),
            num_azimuths=240,
            max_range=14.0,
            people=0.3,
        ),
        voxel_size=0.15,
        extent=(25.0, 50.0),
        step=2.0,
        sway=0.4,
        warp=draw_warp(rng, 0.015, (1.5, 15.0)),
    )


def _hall(rng: np.random.Generator, length: float, width: float, height: float) -> list[Part]:
    """Floor, roof with beams, walls with pilasters at uneven distances, and gates as niches."""
    middle = (0.5 * length, 0.5 * width)
    slab = (length + 1.0, width + 1.0)
    parts = [box(middle, slab, (-0.3, 0.0), "floor"), box(middle, slab, (height, height + 0.3), "ceiling")]
    for y, out in ((0.0, -0.15), (width, 0.15)):
        parts.append(box((middle[0], y + out), (length + 0.6, 0.3), (0.0, height), "wall"))
        for x in np.cumsum(rng.uniform(4.0, 7.0, int(length / 4.0))):
            if x < length - 1.0:
                parts.append(box((x, y - out), (0.4, 0.4), (0.0, height), "wall"))
    for x, out in ((0.0, -0.15), (length, 0.15)):
        gate = float(rng.uniform(3.0, 4.5))
        at = float(rng.uniform(0.25, 0.75)) * width
        for low, high in ((0.0, at - 0.5 * gate), (at + 0.5 * gate, width)):
            parts.append(box((x + out, 0.5 * (low + high)), (0.3, high - low), (0.0, height), "wall"))
        parts.append(box((x + out, at), (0.3, gate), (3.6, height), "wall"))
        parts.append(box((x + 4.0 * out, at), (0.2, gate), (0.0, 3.6), "wall"))
    for x in np.arange(3.0, length, 6.0):
        parts.append(box((x, middle[1]), (0.3, width), (height - 0.6, height), "beam"))
    return parts


def _rack(
    start: float, y: float, bays: int, bay: float, depth: float, levels: int, level: float
) -> list[Part]:
    """Uprights, and one board along all bays for each level above the floor."""
    boards = [
        box((start + 0.5 * bays * bay, y), (bays * bay, depth), (z * level - 0.12, z * level), "rack")
        for z in range(1, levels)
    ]
    top = levels * level
    uprights = [box((start + k * bay, y), (0.1, depth - 0.1), (0.0, top), "rack") for k in range(bays + 1)]
    return boards + uprights


def _pallets(
    rng: np.random.Generator, at: tuple[float, float], bay: float, bottom: float, level: float, filled: float
) -> list[Part]:
    """Up to two stacks in a bay of a level."""
    parts = []
    for side in (-0.25, 0.25):
        if rng.random() < filled:
            size = rng.uniform((0.7, 0.7, 0.4), (1.1, 1.0, level - 0.35))
            centre = (at[0] + side * bay + rng.uniform(-0.08, 0.08), at[1] + rng.uniform(-0.08, 0.08))
            parts.append(
                box(centre, (size[0], size[1]), (bottom, bottom + size[2]), "goods", rng.uniform(-0.06, 0.06))
            )
    return parts


def _goods(rng: np.random.Generator, length: float, margin: float, width: float) -> list[Part]:
    """A stack on the floor at one of the two ends of the racks."""
    x = rng.uniform(0.6, 0.6 * margin) if rng.random() < 0.5 else length - rng.uniform(0.6, 0.6 * margin)
    size = rng.uniform((0.7, 0.6, 0.5), (1.4, 1.1, 1.9))
    centre = (x, rng.uniform(1.0, width - 1.0))
    return [box(centre, (size[0], size[1]), (0.0, size[2]), "goods", rng.uniform(-0.5, 0.5))]
