"""Furniture of a room: cabinets and shelves along the walls, boxes, tables and pillars."""

from typing import NamedTuple

import numpy as np

from .layout import Plan, Room
from .prisms import rectangle


class Item(NamedTuple):
    """A solid piece of furniture.

    Attributes:
        footprint: (4, 2) [m], counterclockwise.
        bottom: Height of its underside above the floor [m].
        top: Height of its upper side [m].
        is_at_wall: Whether its first side touches a wall.
    """

    footprint: np.ndarray
    bottom: float
    top: float
    is_at_wall: bool


def furnish(
    rng: np.random.Generator, plan: Plan, room: Room, *, height: float, clutter: float
) -> list[list[Item]]:
    """Draw the pieces of a room; each is a list of solids (a table has a top and four legs).

    Args:
        rng: Source of chance.
        plan: The building's plan; the surroundings of doors and windows are kept clear.
        room: The room.
        height: Height of the room [m]; pillars reach it.
        clutter: 1 for about three pieces in a room of 20 m².
    """
    polygon = room.polygon
    pieces: list[list[Item]] = []
    area = _area(polygon)
    wanted = rng.poisson(clutter * area * (0.03 if room.is_corridor else 0.15))
    # Pieces are drawn and refused where they do not fit; in a full room the tries end before all have a place.
    for _ in range(4 * wanted):
        if len(pieces) >= wanted:
            break
        piece = _draw_piece(rng, polygon, height)
        if _fits(piece, polygon, plan, pieces):
            pieces.append(piece)
    return pieces


def turned(piece: list[Item], centre: np.ndarray, new_centre: np.ndarray, sign: float) -> list[Item]:
    """The piece moved from one room to an equal one; `sign` -1 turns it by 180 degrees."""
    return [item._replace(footprint=sign * (item.footprint - centre) + new_centre) for item in piece]


def _area(polygon: np.ndarray) -> float:
    """Area of a polygon [m²]."""
    x, y = polygon.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def _draw_piece(rng: np.random.Generator, polygon: np.ndarray, height: float) -> list[Item]:
    """One piece at a random place; it may not fit there."""
    kind = rng.choice(
        ["cabinet", "shelf", "box", "table", "bed", "pillar"], p=[0.3, 0.15, 0.2, 0.15, 0.12, 0.08]
    )
    if kind in ("cabinet", "shelf", "bed"):
        return [_along_wall(rng, polygon, str(kind))]
    # A weighted mean of the corners lies inside of any convex room, whatever its angles are.
    weights = rng.dirichlet(np.ones(4))
    centre, edge = weights @ polygon, polygon[1] - polygon[0]
    yaw = float(np.arctan2(edge[1], edge[0])) + (rng.uniform(-0.8, 0.8) if rng.random() < 0.3 else 0.0)
    if kind == "pillar":
        side = rng.uniform(0.35, 0.5)
        return [Item(rectangle(centre, side, side, yaw), 0.0, height, False)]
    if kind == "box":
        length, width, top = rng.uniform(0.35, 0.9), rng.uniform(0.35, 0.6), rng.uniform(0.4, 1.1)
        return [Item(rectangle(centre, length, width, yaw), 0.0, top, False)]
    return _table(rng, centre, yaw)


def _along_wall(rng: np.random.Generator, polygon: np.ndarray, kind: str) -> Item:
    """A solid whose first side lies on a side of the room."""
    sizes = {
        "cabinet": (0.8, 1.8, 0.4, 0.65, 1.2, 2.1),
        "shelf": (0.6, 1.2, 0.3, 0.4, 0.8, 1.9),
        "bed": (0.8, 1.6, 1.8, 2.1, 0.4, 0.55),
    }[kind]
    length, depth, top = (rng.uniform(sizes[2 * i], sizes[2 * i + 1]) for i in range(3))
    side = rng.integers(4)
    start, end = polygon[side], polygon[(side + 1) % 4]
    u = (end - start) / np.linalg.norm(end - start)
    inward = np.asarray([-u[1], u[0]])
    # A wall may be too short for the piece, which `_fits` refuses then.
    corner = start + rng.uniform(0.4, max(np.linalg.norm(end - start) - length - 0.4, 0.41)) * u
    footprint = np.asarray(
        [corner, corner + length * u, corner + length * u + depth * inward, corner + depth * inward]
    )
    return Item(footprint, 0.0, float(top), True)


def _table(rng: np.random.Generator, centre: np.ndarray, yaw: float) -> list[Item]:
    """A slab on four legs."""
    length, width, top = rng.uniform(1.0, 1.8), rng.uniform(0.6, 0.9), rng.uniform(0.68, 0.78)
    legs = rectangle(centre, length - 0.15, width - 0.15, yaw)
    slab = Item(rectangle(centre, length, width, yaw), float(top) - 0.05, float(top), False)
    return [slab, *(Item(rectangle(leg, 0.07, 0.07, yaw), 0.0, float(top) - 0.05, False) for leg in legs)]


def _fits(piece: list[Item], polygon: np.ndarray, plan: Plan, others: list[list[Item]]) -> bool:
    """Whether the piece keeps clear of walls, doors and other pieces."""
    footprint, at_wall = piece[0].footprint, piece[0].is_at_wall
    along = np.roll(polygon, -1, axis=0) - polygon
    inward = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.linalg.norm(along, axis=-1, keepdims=True)
    gaps = np.min(np.einsum("sk,vsk->vs", inward, footprint[:, None] - polygon[None]), axis=0)
    # A piece at a wall has no gap there, so the next wall is the nearest that counts.
    clear = np.sort(gaps)[1 if at_wall else 0]
    if clear < 0.35 or np.min(gaps) < -1e-6:
        return False
    centre, radius = _circle(footprint)
    if any(np.linalg.norm(door.centre - centre) < radius + 0.8 for door in plan.doors):
        return False
    if any(np.linalg.norm(window[:2] - centre) < radius + window[2] + 0.1 for window in plan.windows):
        return False
    # Circles instead of rectangles are strict enough, and the factor lets long pieces stand side by side.
    circles = [_circle(other[0].footprint) for other in others]
    return all(np.linalg.norm(c - centre) > 0.85 * (r + radius) + 0.15 for c, r in circles)


def _circle(footprint: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle around a rectangle."""
    centre = footprint.mean(axis=0)
    return centre, float(np.linalg.norm(footprint[0] - centre))
