"""A generated place: what stands in it, what may be another thing on another day, and where a sensor goes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..camera import DepthCamera
from ..ground import Ground
from ..lidar import Lidar
from ..prisms import make_prisms, rectangle
from ..scene import Scene
from ..warp import Warp

Part = tuple[np.ndarray, float, float, str]
"""A solid: footprint (4, 2) [m], bottom and top [m], and what it is, in at most nine letters."""


@dataclass(frozen=True)
class Place:
    """One place of a family, with the way that robots take through it.

    Attributes:
        fixed: Solids that stay: walls, floors, trees.
        pieces: What can be moved, each as its solids on one day and those that stand there instead on another;
            either list may be empty.
        path: (n, 3) [m], the places that a sensor passes, in their order.
        sensor: What robots carry here.
        voxel_size: Edge length of a voxel that suits the place [m].
        extent: Shortest and longest stretch of the path that one map covers [m].
        step: Distance between two scans [m].
        sway: How far robots keep off the path, to either side [m].
        gaze: Where the sensor looks: angle to the left of the way [rad]; None for one that looks to all sides.
        ground: Rolling ground, None where solids are the floor.
        warp: How the place is bent, None for not at all.
    """

    fixed: list[Part]
    pieces: list[tuple[list[Part], list[Part]]]
    path: np.ndarray
    sensor: Lidar | DepthCamera
    voxel_size: float
    extent: tuple[float, float]
    step: float
    sway: float
    gaze: float | None = None
    ground: Ground | None = None
    warp: Warp | None = None

    def scene(self, rng: np.random.Generator, changed: float = 0.0) -> Scene:
        """The place on a day.

        Args:
            rng: Source of chance.
            changed: Share of the pieces in whose stead others stand; 1 for another storey of the plan.
        """
        is_other = rng.random(len(self.pieces)) < changed
        chosen = [
            other if is_new else usual for (usual, other), is_new in zip(self.pieces, is_other, strict=True)
        ]
        return Scene(
            make_prisms([*self.fixed, *(part for piece in chosen for part in piece)]), self.ground, self.warp
        )


def box(
    centre: tuple[float, float] | np.ndarray,
    size: tuple[float, float],
    heights: tuple[float, float],
    kind: str,
    yaw: float = 0.0,
) -> Part:
    """An upright box.

    Args:
        centre: (2,) [m].
        size: Length along the direction `yaw`, and width [m].
        heights: Bottom and top [m].
        kind: What it is.
        yaw: Direction of its length [rad].
    """
    return rectangle(np.asarray(centre, np.float64), size[0], size[1], yaw), heights[0], heights[1], kind


def moved(parts: list[Part], shift: np.ndarray, yaw: float = 0.0) -> list[Part]:
    """Parts turned about the origin by `yaw` [rad], then shifted by (3,) [m]."""
    R = np.asarray([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return [(p @ R.T + shift[:2], low + shift[2], high + shift[2], kind) for p, low, high, kind in parts]


def serpentine(rows: Iterable[float], ends: tuple[float, float]) -> np.ndarray:
    """Corners (n, 2) of a way there and back along x, from row to row.

    Args:
        rows: Where along y each row lies.
        ends: Where along x the first row begins and ends; the next one leads back.
    """
    return np.asarray(
        [(x, y) for number, y in enumerate(rows) for x in (ends if number % 2 == 0 else ends[::-1])]
    )


def resampled(path: np.ndarray, step: float) -> np.ndarray:
    """Places (n, d) every `step` [m] along a line of corners (k, d)."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    marks = np.arange(0.0, along[-1], step)
    return np.stack([np.interp(marks, along, column) for column in path.T], axis=-1)
