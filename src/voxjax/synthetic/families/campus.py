"""Campuses: buildings that stand apart on rolling ground, with trees, hedges, low walls and parked cars."""

import numpy as np

from ..ground import Ground
from ..lidar import Lidar
from ..warp import draw_warp
from .garage import car
from .place import Part, Place, box, moved, resampled, serpentine
from .trees import make_tree


def make_campus(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a campus of four by four buildings; cars, tents and containers change.

    Args:
        style: Source of what campuses of one kind share: distance and height of the buildings, trees.
        rng: Source of all else.
    """
    pitch, tall = float(style.uniform(34.0, 46.0)), float(style.uniform(5.0, 14.0))
    trees, count = float(style.uniform(0.001, 0.005)), 4
    side = count * pitch
    ground = Ground(rng, side, float(style.uniform(0.3, 2.5)))
    path = _lanes(rng, pitch, count)
    fixed: list[Part] = []
    for i in range(count):
        for j in range(count):
            # Some squares are lawns.
            if rng.random() < 0.85:
                centre = (np.asarray([i, j]) + 0.5) * pitch + rng.uniform(-2.0, 2.0, 2)
                fixed += _set_down(ground, centre, rng.normal(0.0, 0.15), _building(rng, pitch, tall))
    fixed += _trees(rng, ground, path, np.asarray([part[0].mean(axis=0) for part in fixed]), side, trees)
    pieces = []
    for at in rng.uniform(0.0, side, (160, 2)):
        if np.linalg.norm(path - at, axis=1).min() > 3.0:
            yaw = rng.normal(0.0, 0.1) + 0.5 * np.pi * rng.integers(2)
            usual, other = (_set_down(ground, at, yaw, _movable(rng)) for _ in range(2))
            pieces.append((usual, other))
    return Place(
        fixed=fixed + _low_walls(rng, ground, path, pitch, count),
        pieces=pieces,
        path=np.column_stack([path, ground.at(path) + rng.uniform(1.5, 2.2)]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-22.0, 14.0, 32)),
            upright_beams=np.zeros(0),
            num_azimuths=360,
            max_range=38.0,
            free_range=12.0,
            range_noise=0.03,
            people=0.6,
        ),
        voxel_size=0.4,
        extent=(45.0, 90.0),
        step=6.0,
        sway=1.0,
        ground=ground,
        warp=draw_warp(rng, 0.06, (2.0, 30.0)),
    )


def _lanes(rng: np.random.Generator, pitch: float, count: int) -> np.ndarray:
    """Places (n, 2) on the ways between the rows of buildings, there and back, never quite straight."""
    rows = [row * pitch for row in range(1, count)]
    path = resampled(serpentine(rows, (0.15 * pitch, (count - 0.15) * pitch)), 2.0)
    waves = rng.uniform(0.0, 2.0 * np.pi, 2)
    return path + 0.8 * np.sin(path[:, ::-1] / 9.0 + waves)


def _set_down(ground: Ground, at: np.ndarray, yaw: float, parts: list[Part]) -> list[Part]:
    """Parts turned and put on the ground at a place."""
    return moved(parts, np.asarray([*at, float(ground.at(at[None])[0])]), yaw)


def _building(rng: np.random.Generator, pitch: float, tall: float) -> list[Part]:
    """A block with a wing, bays on its sides, a canopy over the door, and a smaller storey on the roof."""
    size = rng.uniform(0.3, 0.6, 2) * pitch
    height = tall * rng.uniform(0.5, 1.5)
    parts = [box((0.0, 0.0), (size[0], size[1]), (-5.0, height), "wall")]
    if rng.random() < 0.6:
        wing = rng.uniform((0.3, 0.15), (0.6, 0.3)) * pitch
        at = rng.choice((-0.5, 0.5), 2) * size
        parts.append(box(at, (wing[1], wing[0]), (-5.0, height * rng.uniform(0.4, 1.0)), "wall"))
    for _ in range(int(rng.integers(4, 10))):
        wide, deep = rng.uniform(1.0, 4.0), rng.uniform(0.5, 2.0)
        low = rng.choice((-5.0, 0.35 * height))
        along, face = rng.uniform(-0.4, 0.4), float(rng.choice((-0.5, 0.5)))
        if rng.random() < 0.5:
            parts.append(
                box((along * size[0], face * size[1]), (wide, 2.0 * deep), (low, 0.9 * height), "wall")
            )
        else:
            parts.append(
                box((face * size[0], along * size[1]), (2.0 * deep, wide), (low, 0.9 * height), "wall")
            )
    door = rng.uniform(-0.3, 0.3) * size[0]
    parts.append(box((door, 0.5 * size[1] + 1.0), (rng.uniform(2.0, 5.0), 2.0), (2.6, 3.0), "canopy"))
    return parts


def _trees(
    rng: np.random.Generator, ground: Ground, path: np.ndarray, solid: np.ndarray, side: float, density: float
) -> list[Part]:
    """Trees, so many a square metre, off the ways (n, 2) and the middles (n, 2) of what is solid."""
    parts: list[Part] = []
    for at in rng.uniform(0.0, side, (int(density * side * side), 2)):
        is_clear = np.linalg.norm(path - at, axis=1).min() > 2.0
        if is_clear and np.linalg.norm(solid - at, axis=1).min() > 5.0:
            tree = make_tree(rng, height=float(rng.uniform(4.0, 13.0)), clear=float(rng.uniform(1.5, 3.0)))
            parts += _set_down(ground, at, 0.0, tree)
    return parts


def _low_walls(
    rng: np.random.Generator, ground: Ground, path: np.ndarray, pitch: float, count: int
) -> list[Part]:
    """Hedges and low walls along the ways, in lengths of a few metres that follow the ground."""
    parts: list[Part] = []
    for _ in range(count * count):
        at, yaw = rng.uniform(0.0, count * pitch, 2), 0.5 * np.pi * rng.integers(2)
        size = rng.uniform((0.3, 0.5), (1.0, 1.6))
        for k in range(int(rng.integers(2, 6))):
            place = at + 3.0 * k * np.asarray([np.cos(yaw), np.sin(yaw)])
            if np.linalg.norm(path - place, axis=1).min() > 3.5:
                hedge = box((0.0, 0.0), (3.0, size[0]), (-0.6, size[1]), "hedge")
                parts += _set_down(ground, place, yaw, [hedge])
    return parts


def _movable(rng: np.random.Generator) -> list[Part]:
    """A car, a container, or nothing."""
    chance = rng.random()
    if chance < 0.5:
        return []
    if chance < 0.93:
        return car(rng)
    return [box((0.0, 0.0), (rng.uniform(3.0, 6.0), 2.4), (-0.3, 2.5), "container")]
