"""Large halls: equal bays of columns and windows, a stage, a gallery, and tables, stands and rows of seats."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, serpentine


def make_hall(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a hall; what stands on its floor changes.

    Args:
        style: Source of what halls of one builder share: bays, columns, height.
        rng: Source of all else.
    """
    bay, height = float(style.uniform(4.0, 6.0)), float(style.uniform(5.5, 10.0))
    column, sill = float(style.uniform(0.4, 0.9)), float(style.uniform(0.9, 2.0))
    bays, width = int(rng.integers(12, 19)), float(rng.uniform(18.0, 28.0))
    length, aside = bays * bay, float(style.uniform(2.5, 4.5))
    fixed = _shell(bays, bay, width, height, sill)
    for k in range(1, bays):
        # A gap in a row of columns, where people come in.
        fixed += [
            box((k * bay, y), (column, column), (0.0, height), "column")
            for y in (aside, width - aside)
            if rng.random() < 0.92
        ]
    fixed += _ends(rng, length, width, height, aside)
    pieces = []
    for _ in range(int(rng.integers(40, 70))):
        at = rng.uniform((4.0, aside + 0.8), (length - 5.0, width - aside - 0.8))
        pieces.append((_thing(rng, at), _thing(rng, at)))
    lanes = serpentine((0.5 * aside, 0.35 * width, 0.65 * width, width - 0.5 * aside), (3.0, length - 6.0))
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=np.column_stack([lanes, np.full(len(lanes), rng.uniform(1.0, 1.8))]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-22.0, 22.0, 18)),
            upright_beams=np.radians(np.linspace(-55.0, 55.0, 14)),
            num_azimuths=260,
            max_range=13.0,
            people=0.8,
        ),
        voxel_size=0.18,
        extent=(18.0, 36.0),
        step=2.2,
        sway=0.5,
        warp=draw_warp(rng, 0.015, (1.5, 20.0)),
    )


def _shell(bays: int, bay: float, width: float, height: float, sill: float) -> list[Part]:
    """Floor, roof with a beam in each bay, and long walls of piers with windows between them."""
    length = bays * bay
    middle, slab = (0.5 * length, 0.5 * width), (length + 1.0, width + 2.0)
    parts = [box(middle, slab, (-0.3, 0.0), "floor"), box(middle, slab, (height, height + 0.3), "ceiling")]
    for y, out in ((0.0, -0.2), (width, 0.2)):
        parts += [
            box((0.5 * length, y + out), (length, 0.4), (0.0, sill), "wall"),
            box((0.5 * length, y + out), (length, 0.4), (0.75 * height, height), "wall"),
            box((0.5 * length, y + 2.0 * out), (length, 0.1), (0.0, height), "window"),
        ]
        parts += [box((k * bay, y + out), (0.3 * bay, 0.4), (0.0, height), "wall") for k in range(bays + 1)]
    parts += [
        box((k * bay, 0.5 * width), (0.35, width), (height - 0.7, height), "beam") for k in range(1, bays)
    ]
    return parts


def _ends(rng: np.random.Generator, length: float, width: float, height: float, aside: float) -> list[Part]:
    """Both end walls, one with a stage, the other with doors below a gallery."""
    half = 0.5 * width
    parts = [box((x, half), (0.4, width + 0.8), (0.0, height), "wall") for x in (-0.2, length + 0.2)]
    stage = rng.uniform((2.5, 0.5, 0.7), (4.5, 0.8, 1.2))
    parts.append(box((length - 0.5 * stage[0], half), (stage[0], stage[1] * width), (0.0, stage[2]), "stage"))
    gallery = float(rng.uniform(0.4, 0.55)) * height
    parts.append(box((0.9, half), (1.8, width), (gallery, gallery + 1.2), "gallery"))
    for _ in range(3):
        # Posts of the doors stand out before the wall.
        at, wide = rng.uniform(0.1, 0.9) * width, rng.uniform(0.9, 1.6)
        parts += [box((0.1, at + s * wide), (0.2, 0.25), (0.0, 2.4), "door") for s in (-0.5, 0.5)]
    # A stair or a kiosk takes up a part of one aisle.
    x, side = rng.uniform(0.2, 0.8) * length, float(rng.integers(2))
    size = rng.uniform((2.0, 1.2, 2.0), (5.0, 2.0, 3.2))
    y = 0.5 * size[1] if side == 0.0 else width - 0.5 * size[1]
    parts.append(box((x, y), (size[0], min(size[1], aside - 1.2)), (0.0, size[2]), "kiosk"))
    return parts


def _thing(rng: np.random.Generator, at: np.ndarray) -> list[Part]:
    """A table, a stand of an exhibition, a row of seats, or nothing."""
    chance, yaw = rng.random(), rng.uniform(-0.2, 0.2) + 0.5 * np.pi * rng.integers(2)
    if chance < 0.2:
        return []
    if chance < 0.5:
        size = rng.uniform((1.2, 0.7), (2.0, 0.9))
        return [
            box(at, (size[0], size[1]), (0.68, 0.75), "table", yaw),
            box(at, (0.6 * size[0], 0.1), (0.0, 0.68), "table", yaw),
        ]
    if chance < 0.75:
        size = rng.uniform((1.0, 0.4, 1.2), (3.0, 1.2, 2.6))
        return [box(at, (size[0], size[1]), (0.0, size[2]), "stand", yaw)]
    along = np.asarray([np.cos(yaw), np.sin(yaw)])
    return [
        part
        for k in range(int(rng.integers(3, 7)))
        for part in (
            box(at + 0.65 * k * along, (0.45, 0.45), (0.35, 0.45), "seat", yaw),
            box(at + 0.65 * k * along + 0.2 * along[::-1] * (-1, 1), (0.45, 0.06), (0.3, 0.9), "seat", yaw),
        )
    ]
