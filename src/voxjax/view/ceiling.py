"""Closed buildings are drawn without their ceiling, whichever way their map leans.

What is up is read off the map: the direction, of those that its surface faces, along which the building is closed on
both ends. Which of these ends is the ceiling and which the floor is not asked: the one toward the eye hides the rooms.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..registration.hypotheses.directions import dominant_directions


class Cut(NamedTuple):
    """What is drawn of a building: the voxels whose index, along a direction, is less than a height.

    Attributes:
        up: float64 (3,): unit vector, toward the eye.
        height: In voxels along it.
    """

    up: Float[np.ndarray, "3"]
    height: float

    @property
    def is_upright(self) -> bool:
        """Whether the direction is that of z."""
        return bool(self.up[2] == 1.0)

    def keeps(self, index: Int[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which voxels are drawn.

        Args:
            index: The voxels.
        """
        return _along(index, self.up) < self.height


class _Ends(NamedTuple):
    """A map along one direction: where it begins and ends, and its columns that are filled at both.

    Attributes:
        up: float64 (3,): the direction.
        low: Lowest voxel along it, apart from strays.
        high: One past the highest.
        area: Of its columns with something above the cut, and something below half of its height [voxel squared].
        closed_share: Share of these columns among all that hold something.
    """

    up: np.ndarray
    low: int
    high: int
    area: int
    closed_share: float


def ceiling_cut(is_occupied: Bool[np.ndarray, "x y z"], *, share: float = 0.7) -> int:
    """Height [voxel] above which a closed building that stands upright is cut open; else the number of layers.

    Args:
        is_occupied: The map.
        share: Of the building's height, what stays.
    """
    if not is_occupied.any():
        return is_occupied.shape[2]
    ends = _ends(np.argwhere(is_occupied), np.array([0.0, 0.0, 1.0]), share)
    return _cut_height(ends, share) if ends.closed_share > 1 / 3 else is_occupied.shape[2]


def find_cut(
    index: Int[np.ndarray, "n 3"], *, eye: tuple[float, float, float], share: float = 0.7
) -> Cut | None:
    """Where a closed building is cut open so that its rooms are seen; None if it is not closed, or up is not clear.

    Args:
        index: The occupied voxels, in lexicographic order.
        eye: Direction from the map to the eye.
        share: Of the building's height, what stays.
    """
    ends = _closed_ends(index, share) if len(index) else None
    if ends is None:
        return None
    toward = ends.up @ np.asarray(eye) / np.linalg.norm(eye)
    # Along a ceiling one does not look into the rooms below it, and the cut would only take a part of the map away.
    if abs(toward) < math.sin(math.radians(20.0)):
        return None
    if toward > 0.0:
        return Cut(ends.up, float(_cut_height(ends, share)))
    # Seen from below, the floor is what hides the rooms: the same from the other end.
    turned = ends._replace(up=-ends.up, low=1 - ends.high, high=1 - ends.low)
    return Cut(turned.up, float(_cut_height(turned, share)))


def _closed_ends(index: np.ndarray, share: float) -> _Ends | None:
    """The ends of a building along its own up, or None where it is open or up is not clear."""
    # Where no plane says what is up, as in a cave, z is.
    directions = _surface_directions(index) or [np.array([0.0, 0.0, 1.0])]
    found = [_ends(index, direction, share) for direction in directions]
    # A street is closed between its houses, in half of its columns. Of a building most columns end at floor and
    # ceiling, and more of them than at two of its walls.
    closed = [ends for ends in found if ends.closed_share > 2 / 3]
    most = max(closed, key=lambda ends: ends.area, default=None)
    if directions[0][2] < math.cos(math.radians(20.0)):
        return most
    # Maps mostly stand about upright, some of them without a ceiling; and up to twice as high as they are wide.
    upright = found[0]
    if upright.closed_share <= 1 / 3:
        return None
    return most if most is not None and most.area > 2 * upright.area else upright


def _surface_directions(index: np.ndarray, *, cell: int = 8, min_share: float = 0.1) -> list[np.ndarray]:
    """Directions that much of the surface faces, with z >= 0, the nearest to z first.

    Planes are fitted to what lies in each cell of the map, so that each counts by its voxels.
    """
    place = index // cell
    _, group = np.unique(_flat(place), return_inverse=True)
    count = np.bincount(group).astype(np.float64)
    local = (index - cell * place).astype(np.float64)
    mean = np.stack([np.bincount(group, local[:, k]) for k in range(3)], axis=1) / count[:, None]
    local -= mean[group]
    scatter = np.empty((len(count), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            scatter[:, i, j] = scatter[:, j, i] = np.bincount(group, local[:, i] * local[:, j]) / count
    spread, axes = np.linalg.eigh(scatter)
    # Thin in one direction and wide in the two others.
    is_plane = (spread[:, 0] < 0.1 * spread[:, 1]) & (spread[:, 1] > 0.2 * spread[:, 2]) & (count > 2 * cell)
    if not is_plane.any():
        return []
    normals, weights = axes[is_plane, :, 0].astype(np.float32), count[is_plane].astype(np.float32)
    directions, shares = dominant_directions(normals, weights)
    found = [_snapped(d if d[2] >= 0.0 else -d) for d in directions[shares >= min_share]]
    return sorted(found, key=lambda d: -d[2])


def _snapped(direction: np.ndarray) -> np.ndarray:
    """The direction, or z itself within a degree of it: layers of voxels are cut cleanly."""
    z = np.array([0.0, 0.0, 1.0])
    return z if direction[2] > math.cos(math.radians(1.0)) else direction


def _ends(index: np.ndarray, up: np.ndarray, share: float) -> _Ends:
    """Where a map that holds something begins and ends along a direction, and how far it is closed there."""
    height = np.floor(_along(index, up)).astype(np.int64)
    base = int(height.min())
    layers = np.bincount(height - base)
    filled = np.flatnonzero(layers >= 0.002 * len(index))  # single stray voxels do not count
    low, high = (int(filled[0]), int(filled[-1]) + 1) if filled.size else (0, len(layers))
    ends = _Ends(up, base + low, base + high, 0, 0.0)
    column, side = _columns(index, up)
    is_high = (height >= _cut_height(ends, share)) & (height < ends.high)
    # A ceiling has a floor far below it: a building that stands higher up than another is none.
    is_below = height < ends.low + share / 2.0 * (ends.high - ends.low)
    _, group = np.unique(column, return_inverse=True)
    has_high, has_low = np.bincount(group, is_high) > 0, np.bincount(group, is_below) > 0
    num_covered = int(np.count_nonzero(has_high & has_low))
    return ends._replace(area=side * side * num_covered, closed_share=num_covered / len(has_high))


def _cut_height(ends: _Ends, share: float) -> int:
    """The height of the cut between the ends."""
    return ends.low + max(round(share * (ends.high - ends.low)), 1)


def _along(index: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Height of each voxel along a direction [voxel]."""
    return index[:, 2] if up[2] == 1.0 else index @ up


def _columns(index: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, int]:
    """A number for the column along a direction that each voxel lies in, and how wide columns are [voxel]."""
    if up[2] == 1.0:
        return _flat(index[:, :2]), 1
    # Planes that lean have holes of single voxels when they are seen along their columns.
    across = np.linalg.svd(up[None])[2][1:]
    return _flat(np.floor(index @ across.T / 2.0).astype(np.int64)), 2


def _flat(place: np.ndarray) -> np.ndarray:
    """One number for each distinct row."""
    local = place - place.min(axis=0)
    return np.asarray(np.ravel_multi_index(tuple(local.T), tuple(local.max(axis=0) + 1)))
