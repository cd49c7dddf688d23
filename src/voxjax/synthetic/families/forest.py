"""Forests: trunks, crowns, bushes, stones and fallen trees on rolling ground."""

import numpy as np

from ..ground import Ground
from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box, moved, resampled
from .trees import make_tree


def make_forest(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a forest of 110 m with a trail; fallen trees, bushes and stacks of wood change.

    Args:
        style: Source of what forests of one kind share: how dense and how high it is, its ground.
        rng: Source of all else.
    """
    side, density = 110.0, float(style.uniform(0.02, 0.06))
    tall, clear = float(style.uniform(7.0, 15.0)), float(style.uniform(0.15, 0.5))
    ground = Ground(rng, side, float(style.uniform(0.8, 3.0)))
    trail = _trail(rng, side)
    # The way is kept free of trees.
    places = _apart(rng.uniform(0.0, side, (int(density * side * side), 2)), trail, 1.3)
    fixed: list[Part] = []
    for at, z in zip(places, ground.at(places), strict=True):
        height = tall * rng.uniform(0.6, 1.3)
        fixed += moved(make_tree(rng, height=height, clear=clear * height), np.asarray([*at, z]))
    spots = _apart(rng.uniform(0.0, side, (260, 2)), trail, 1.8)
    pieces = [
        (_undergrowth(rng, at, z), _undergrowth(rng, at, z))
        for at, z in zip(spots, ground.at(spots), strict=True)
    ]
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=np.column_stack([trail, ground.at(trail) + rng.uniform(1.3, 1.9)]),
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-25.0, 20.0, 28)),
            upright_beams=np.zeros(0),
            num_azimuths=360,
            max_range=20.0,
            free_range=8.0,
            range_noise=0.03,
            people=0.2,
        ),
        voxel_size=0.25,
        extent=(25.0, 45.0),
        step=3.0,
        sway=0.5,
        ground=ground,
        warp=draw_warp(rng, 0.07, (0.7, 6.0)),
    )


def _trail(rng: np.random.Generator, side: float) -> np.ndarray:
    """A way (n, 2) from the middle of the near edge to that of the far one and back beside it, never straight."""
    x = np.linspace(12.0, side - 12.0, 14)
    there = np.column_stack([x, 0.3 * side + rng.normal(0.0, 4.0, len(x))])
    back = np.column_stack([x[::-1], 0.7 * side + rng.normal(0.0, 4.0, len(x))])
    return resampled(np.concatenate([there, back]), 2.0)


def _apart(places: np.ndarray, trail: np.ndarray, clearance: float) -> np.ndarray:
    """Those places that lie off the trail and from those before them by `clearance` [m]."""
    taken = [*trail]
    kept = []
    for at in places:
        if np.linalg.norm(np.asarray(taken) - at, axis=1).min() > clearance:
            taken.append(at)
            kept.append(at)
    return np.asarray(kept).reshape(-1, 2)


def _undergrowth(rng: np.random.Generator, at: np.ndarray, z: float) -> list[Part]:
    """A bush, a stone, a fallen tree, or nothing, at a place on the ground."""
    return moved(_thing(rng), np.asarray([*at, z]), rng.uniform(0.0, np.pi))


def _thing(rng: np.random.Generator) -> list[Part]:
    """The thing at the origin."""
    chance = rng.random()
    if chance < 0.25:
        return []
    if chance < 0.4:
        return [
            box(
                (0.0, 0.0),
                (rng.uniform(2.0, 6.0), rng.uniform(0.2, 0.4)),
                (-0.2, rng.uniform(0.25, 0.5)),
                "log",
            )
        ]
    if chance < 0.6:
        return [box((0.0, 0.0), tuple(rng.uniform(0.4, 1.3, 2)), (-0.5, rng.uniform(0.2, 0.7)), "stone")]
    return [
        box(
            rng.normal(0.0, 0.3, 2),
            tuple(rng.uniform(0.3, 0.9, 2)),
            (-0.2, rng.uniform(0.4, 1.5)),
            "bush",
            rng.uniform(0, np.pi),
        )
        for _ in range(2)
    ]
