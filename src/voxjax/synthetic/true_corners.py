"""True corners of a generated building: the points where three faces meet, with their normals."""

from typing import NamedTuple

import numpy as np

from .furniture import Item
from .layout import WALL_THICKNESS, Plan, Wall
from .prisms import make_prisms

_UP = np.asarray([0.0, 0.0, 1.0])


class TrueCorners(NamedTuple):
    """Corners in the frame of the world.

    Attributes:
        position: (n, 3) [m].
        normals: (n, 3, 3): unit rows, each the normal of one face, into free space.
        kind: (n,) names: "room", "furniture" or "opening".
    """

    position: np.ndarray
    normals: np.ndarray
    kind: np.ndarray


def find_true_corners(plan: Plan, height: float, furniture: list[list[Item]]) -> TrueCorners:
    """Corners of rooms, of furniture and of door and window frames.

    Corners of furniture that stands at a wall or on the floor are formed with the wall or the floor.
    """
    found = [(corner, "room") for room in plan.rooms for corner in _room_corners(room.polygon, height)]
    found += [(c, "furniture") for piece in furniture for item in piece for c in _item_corners(item, height)]
    found += [(corner, "opening") for wall in plan.walls for corner in _opening_corners(wall)]
    position = np.asarray([corner[0] for corner, _ in found], np.float64).reshape(-1, 3)
    normals = np.asarray([corner[1] for corner, _ in found], np.float64).reshape(-1, 3, 3)
    return TrueCorners(position, normals, np.asarray([kind for _, kind in found], dtype="U9"))


def _flat(normal: np.ndarray) -> np.ndarray:
    """A horizontal normal as (3,)."""
    return np.asarray([normal[0], normal[1], 0.0])


def _room_corners(polygon: np.ndarray, height: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Floor and ceiling with two walls."""
    # A room is a prism of air: its normals, turned round, point into free space.
    inward = -make_prisms([(polygon, 0.0, height, "wall")]).side_normals[0]
    return [
        (np.asarray([*vertex, z]), np.stack([_flat(inward[i]), _flat(inward[i - 1]), up * _UP]))
        for i, vertex in enumerate(polygon)
        for z, up in ((0.0, 1.0), (height, -1.0))
    ]


def _item_corners(item: Item, height: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """The vertices of a box that stands on the floor."""
    # Shorter edges leave faces of a voxel or two, which no map shows as planes [m].
    smallest_edge = 0.25
    edges = np.linalg.norm(np.roll(item.footprint, -1, axis=0) - item.footprint, axis=-1)
    if min(edges.min(), item.top - item.bottom) < smallest_edge:
        return []
    outward = make_prisms([(item.footprint, item.bottom, item.top, "furniture")]).side_normals[0]
    if item.is_at_wall:  # the wall's own face takes the place of the side that touches it
        outward = np.concatenate([-outward[:1], outward[1:]])
    # A pillar reaches the ceiling, whose face looks down.
    top_sign = 1.0 if item.top < height else -1.0
    return [
        (np.asarray([*vertex, z]), np.stack([_flat(outward[i]), _flat(outward[i - 1]), up * _UP]))
        for i, vertex in enumerate(item.footprint)
        for z, up in ((item.bottom, 1.0), (item.top, top_sign))
    ]


def _opening_corners(wall: Wall) -> list[tuple[np.ndarray, np.ndarray]]:
    """Jamb, wall face and lintel, sill or floor, on both faces of the wall."""
    u = wall.along
    across = np.asarray([-u[1], u[0]])
    found = []
    for opening in wall.openings:
        for s, jamb in ((opening.start, u), (opening.start + opening.width, -u)):
            for side in (1.0, -1.0):
                place = wall.start + s * u + side * 0.5 * WALL_THICKNESS * across
                for z, up in ((opening.bottom, 1.0), (opening.top, -1.0)):
                    rows = np.stack([_flat(side * across), _flat(jamb), up * _UP])
                    found.append((np.asarray([*place, z]), rows))
    return found
