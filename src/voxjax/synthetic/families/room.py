"""Furnished rooms as a depth camera sees them: fragments of a few metres, with small things on the furniture."""

import numpy as np

from ..building import make_building
from ..camera import DepthCamera
from ..furniture import Item, furnish
from ..prisms import make_prisms
from ..warp import draw_warp
from .place import Part, Place, box, resampled
from .storeys import paired


def make_room(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a room full of furniture; furniture is what changes.

    Args:
        style: Source of what rooms of one house share: height, how full they are.
        rng: Source of all else.
    """
    height, clutter = float(style.uniform(2.4, 2.9)), float(style.uniform(2.0, 3.5))
    building = make_building(rng, clutter=0.0, num_rows=1, width=float(rng.uniform(6.5, 9.0)), height=height)
    fixed = [
        (footprint, float(z[0]), float(z[1]), str(kind))
        for footprint, z, kind in zip(*building.solids, strict=True)
    ]
    path, days = _round(rng, [room.polygon for room in building.plan.rooms]), []
    for _ in range(2):
        pieces = [
            p
            for room in building.plan.rooms
            for p in furnish(rng, building.plan, room, height=height, clutter=clutter)
        ]
        laden = [_laden(rng, piece) for piece in pieces]
        # Nobody carries a camera through a cabinet.
        days.append([parts for parts in laden if make_prisms(parts).distance(path).min() > 0.35])
    return Place(
        fixed=fixed,
        pieces=paired(*days),
        path=path,
        sensor=DepthCamera(),
        voxel_size=0.04,
        extent=(0.9, 2.0),
        step=0.1,
        sway=0.05,
        gaze=-0.5 * np.pi,
        warp=draw_warp(rng, 0.008, (0.4, 4.0)),
    )


def _round(rng: np.random.Generator, polygons: list[np.ndarray]) -> np.ndarray:
    """A way (n, 3) round the middle of each room."""
    angles = np.linspace(0.0, 2.0 * np.pi, 13)
    ways = []
    for polygon in polygons:
        centre = polygon.mean(axis=0)
        a, b = 0.5 * (polygon[1] - polygon[0]), 0.5 * (polygon[3] - polygon[0])
        share = rng.uniform(0.12, 0.28)
        ways.append(centre + share * (np.cos(angles)[:, None] * a + np.sin(angles)[:, None] * b))
    path = np.concatenate(ways)
    path = resampled(path, 0.1)
    return np.column_stack([path, rng.uniform(1.2, 1.6) + 0.1 * np.sin(0.3 * np.arange(len(path)))])


def _laden(rng: np.random.Generator, piece: list[Item]) -> list[Part]:
    """The piece, with small boxes on its upper side."""
    parts = [(item.footprint, item.bottom, item.top, "furniture") for item in piece]
    top = piece[0]
    if top.top > 1.5:
        return parts
    for _ in range(rng.poisson(2.5)):
        centre = rng.dirichlet(np.ones(4)) @ top.footprint
        size = rng.uniform((0.1, 0.06, 0.05), (0.5, 0.3, 0.45))
        parts.append(
            box(centre, (size[0], size[1]), (top.top, top.top + size[2]), "thing", rng.uniform(0.0, np.pi))
        )
    return parts
