"""Room-and-pillar mines: pillars of rock left standing between drifts that cross, roof and floor uneven."""

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, serpentine


def make_mine(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a mine; heaps of broken rock and machines change.

    Args:
        style: Source of what mines of one kind share: distance and size of the pillars, height.
        rng: Source of all else.
    """
    pitch = style.uniform((9.0, 9.0), (13.0, 13.0))
    drift, height = float(style.uniform(4.5, 6.0)), float(style.uniform(2.6, 4.0))
    columns, rows = 7, 5
    fixed: list[Part] = []
    for i in range(-1, columns + 1):
        for j in range(-1, rows + 1):
            centre = (np.asarray([i, j]) + 0.5) * pitch + rng.normal(0.0, 0.4, 2)
            # Around the mine is rock without drifts.
            is_rim = not (0 <= i < columns and 0 <= j < rows)
            size = pitch + 1.0 if is_rim else pitch - drift + rng.normal(0.0, 0.5, 2)
            fixed.append(_pillar(rng, centre, size, height))
    fixed += _slabs(rng, columns, rows, pitch, height)
    pieces = []
    for _ in range(4 * columns):
        at = np.asarray([rng.uniform(0.0, columns), rng.integers(1, rows)]) * pitch
        at = at + rng.uniform(0.25, 0.45) * drift * np.asarray([0.0, rng.choice((-1.0, 1.0))])
        pieces.append((_heap(rng, at), _heap(rng, at)))
    path = serpentine([float(row) for row in range(1, rows)], (1.0, columns - 1.0)) * pitch
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=np.column_stack([path, np.full(len(path), 1.5)]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-20.0, 20.0, 20)),
            upright_beams=np.radians(np.linspace(-40.0, 40.0, 8)),
            num_azimuths=300,
            max_range=20.0,
            people=0.0,
        ),
        voxel_size=0.2,
        extent=(30.0, 60.0),
        step=2.5,
        sway=0.6,
        warp=draw_warp(rng, (0.16, 0.16, 0.2), (1.2, 14.0)),
    )


def _pillar(rng: np.random.Generator, centre: np.ndarray, size: np.ndarray, height: float) -> Part:
    """A quadrilateral with corners off a rectangle's."""
    footprint, low, top, kind = box(centre, (float(size[0]), float(size[1])), (-1.0, height + 1.0), "rock")
    # Shifts of less than a quarter of the shorter side keep it convex.
    limit = 0.12 * float(min(size))
    return footprint + rng.uniform(-limit, limit, (4, 2)), low, top, kind


def _slabs(rng: np.random.Generator, columns: int, rows: int, pitch: np.ndarray, height: float) -> list[Part]:
    """Floor and roof in slabs of half a pitch, each at a height of its own."""
    parts = []
    for i in range(2 * columns):
        for j in range(2 * rows):
            centre, size = (np.asarray([i, j]) + 0.5) * 0.5 * pitch, (0.5 * pitch[0], 0.5 * pitch[1])
            parts.append(box(centre, size, (-1.0, 0.08 * rng.normal()), "floor"))
            parts.append(box(centre, size, (height + 0.25 * rng.normal(), height + 2.0), "ceiling"))
    return parts


def _heap(rng: np.random.Generator, at: np.ndarray) -> list[Part]:
    """Broken rock, a machine, or nothing."""
    chance = rng.random()
    if chance < 0.4:
        return []
    yaw = rng.uniform(-np.pi, np.pi)
    if chance < 0.55:
        return [
            box(
                at,
                (rng.uniform(2.5, 4.0), rng.uniform(1.3, 1.8)),
                (-0.2, rng.uniform(1.2, 2.0)),
                "machine",
                0.3 * yaw,
            )
        ]
    return [
        box(
            at + rng.normal(0.0, 0.5, 2),
            tuple(rng.uniform(0.5, 1.3, 2)),
            (-0.5, rng.uniform(0.2, 0.9)),
            "rock",
            yaw,
        )
        for _ in range(3)
    ]
