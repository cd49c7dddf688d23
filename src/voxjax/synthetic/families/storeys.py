"""Storeys of one plan: the same walls, doors and windows, other furniture."""

import numpy as np

from ..building import make_building
from ..furniture import Item, furnish
from ..lidar import Lidar
from ..trajectory import visit_rooms
from ..warp import draw_warp
from .place import Part, Place


def make_storey(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a storey; its other pieces are the furniture of another storey of the same plan.

    Args:
        style: Source of what places of one kind share: size, height of the rooms, how full they are.
        rng: Source of all else.
    """
    width, height = float(style.uniform(15.0, 24.0)), float(style.uniform(2.5, 3.1))
    clutter = float(style.uniform(1.2, 2.5))
    building = make_building(rng, clutter=0.0, num_rows=3, width=width, height=height)
    fixed = [
        (footprint, float(z[0]), float(z[1]), str(kind))
        for footprint, z, kind in zip(*building.solids, strict=True)
    ]
    days = []
    for _ in range(2):
        pieces = [
            p
            for room in building.plan.rooms
            for p in furnish(rng, building.plan, room, height=height, clutter=clutter)
        ]
        # Pillars carry the storey above and stand in all of them alike.
        days.append([p for p in pieces if p[0].top < height])
    path = np.asarray(visit_rooms(rng, building, list(range(building.num_rooms))))
    return Place(
        fixed=fixed,
        pieces=paired(*([_solid(piece) for piece in day] for day in days)),
        path=np.column_stack([path, np.full(len(path), rng.uniform(1.0, 1.3))]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-22.0, 22.0, 16)),
            upright_beams=np.radians(np.linspace(-45.0, 45.0, 16)),
            num_azimuths=240,
            max_range=9.0,
            people=0.2,
        ),
        voxel_size=0.1,
        extent=(15.0, 30.0),
        step=1.2,
        sway=0.15,
        warp=draw_warp(rng, 0.012, (1.5, 12.0)),
    )


def paired(usual: list[list[Part]], other: list[list[Part]]) -> list[tuple[list[Part], list[Part]]]:
    """Pieces of two days, one of each after the other; the longer list goes with nothing in the end."""
    most = max(len(usual), len(other))
    filled = [day + [[]] * (most - len(day)) for day in (usual, other)]
    return list(zip(*filled, strict=True))


def _solid(piece: list[Item]) -> list[Part]:
    return [(item.footprint, item.bottom, item.top, "furniture") for item in piece]
