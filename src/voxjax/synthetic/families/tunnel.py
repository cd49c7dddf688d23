"""Tunnels: two walls, a floor and a roof of pieces along a line that bends, with niches or side drifts."""

from itertools import pairwise

import numpy as np

from ..lidar import Lidar
from ..warp import draw_warp
from .place import Part, Place, box


def make_tunnel(style: np.random.Generator, rng: np.random.Generator) -> Place:
    """Draw a tunnel, of concrete with niches at equal distances or rough rock; tools at its sides change.

    Args:
        style: Source of what tunnels of one kind share: section, roughness, distance of the niches.
        rng: Source of all else.
    """
    width, height = float(style.uniform(3.2, 5.5)), float(style.uniform(2.8, 4.2))
    is_rock = bool(style.random() < 0.5)
    piece, bend = (1.8, 0.11) if is_rock else (2.5, 0.04)
    niche = int(style.integers(5, 9))
    line = _line(rng, 75, piece, bend)
    fixed: list[Part] = []
    for k, (a, b) in enumerate(pairwise(line)):
        deep = 0.0
        if k % niche == niche - 1:
            # Niches of a concrete tunnel are equal, side drifts in rock are not.
            deep = float(rng.uniform(1.5, 5.0)) if is_rock else 0.8
        fixed += _ring(rng, a, b, (width, height), 0.22 if is_rock else 0.0, deep)
    pieces = [
        (_tool(rng, line, k, width), _tool(rng, line, k, width))
        for k in range(len(line) - 1)
        if rng.random() < 0.5
    ]
    path = np.column_stack([line, np.full(len(line), 0.42 * height)])
    return Place(
        fixed=fixed,
        pieces=pieces,
        path=path,
        sensor=Lidar(
            level_beams=np.radians(np.linspace(-20.0, 20.0, 16)),
            upright_beams=np.radians(np.linspace(-50.0, 50.0, 12)),
            num_azimuths=300,
            max_range=20.0,
            people=0.1,
        ),
        voxel_size=0.15,
        extent=(28.0, 50.0),
        step=2.2,
        sway=0.3,
        warp=draw_warp(rng, 0.13 if is_rock else 0.015, (0.9, 9.0)),
    )


def _line(rng: np.random.Generator, count: int, piece: float, bend: float) -> np.ndarray:
    """Places (n, 2) on the middle of the tunnel; its bends come and go."""
    turns = np.convolve(rng.normal(size=count + 8), np.ones(9) / 3.0, mode="valid") * bend
    headings = np.cumsum(turns)
    # A tunnel that turned round would run into itself.
    headings = 1.2 * np.sin(headings / 1.2)
    steps = piece * np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _ring(
    rng: np.random.Generator,
    a: np.ndarray,
    b: np.ndarray,
    section: tuple[float, float],
    rough: float,
    deep: float,
) -> list[Part]:
    """Walls, floor and roof of one piece; rough ones stand out by some and are turned by some.

    Where `deep` [m] is above 0, one of the walls stands back by so much, between two others.
    """
    along, (width, height) = b - a, section
    length, yaw = float(np.linalg.norm(along)), float(np.arctan2(along[1], along[0]))
    across = np.asarray([-along[1], along[0]]) / length
    middle, heights = 0.5 * (a + b), (-1.0, height + 1.0)
    open_side = float(rng.choice((-1.0, 1.0))) if deep > 0.0 else 0.0
    parts = []
    for side in (-1.0, 1.0):
        out = 0.5 * width + 0.5 + rough * rng.normal()
        if side == open_side:
            centre = middle + side * (0.5 * width + 0.5 * deep) * across
            parts += [
                box(centre + s * (0.5 * length + 0.2) * along / length, (0.4, deep), heights, "wall", yaw)
                for s in (-1.0, 1.0)
            ]
            out += deep
        turned = yaw + 0.5 * rough * rng.normal()
        parts.append(box(middle + side * out * across, (length + 0.6, 1.0), heights, "wall", turned))
    # Floor and roof reach past the walls, so that no ray leaves along an edge.
    span = (length + 0.4, width + 3.0 + 2.0 * deep)
    parts.append(box(middle, span, (-1.0, 0.4 * rough * rng.normal()), "floor", yaw))
    parts.append(box(middle, span, (height + rough * rng.normal(), height + 1.5), "ceiling", yaw))
    return parts


def _tool(rng: np.random.Generator, line: np.ndarray, k: int, width: float) -> list[Part]:
    """A box, a cabinet or a stack of pipes beside a wall, or nothing."""
    if rng.random() < 0.4:
        return []
    along = line[k + 1] - line[k]
    along /= np.linalg.norm(along)
    across, side = np.asarray([-along[1], along[0]]), rng.choice((-1.0, 1.0))
    size = rng.uniform((0.4, 0.3, 0.4), (1.8, 0.6, 1.9))
    centre = line[k] + rng.uniform(0.0, 1.5) * along + side * (0.5 * width - 0.5 * size[1] - 0.15) * across
    yaw = float(np.arctan2(along[1], along[0])) + rng.uniform(-0.1, 0.1)
    return [box(centre, (size[0], size[1]), (-0.1, size[2]), "tool", yaw)]
