"""Generated buildings: rooms, doors, windows and furniture as solids, with their true corners."""

from dataclasses import dataclass, replace

import numpy as np

from .furniture import Item, furnish, turned
from .layout import DOOR_HEIGHT, WALL_THICKNESS, Plan, Wall, make_plan
from .prisms import Prisms, join_prisms, make_prisms, rectangle
from .scene import Scene
from .true_corners import TrueCorners, find_true_corners


@dataclass(frozen=True)
class Building:
    """One storey, floor at z = 0.

    Attributes:
        plan: Walls, rooms and doors of the building.
        height: Height of the rooms [m].
        furniture: Pieces of all rooms.
        solids: Everything that a ray can meet.
        corners: Where three faces meet.
    """

    plan: Plan
    height: float
    furniture: list[list[Item]]
    solids: Prisms
    corners: TrueCorners

    @property
    def num_rooms(self) -> int:
        """Number of rooms, the corridor included."""
        return len(self.plan.rooms)

    @property
    def scene(self) -> Scene:
        """What a sensor meets in it."""
        return Scene(self.solids)

    def neighbours(self, room: int) -> list[int]:
        """Rooms that a door joins to `room`, in rising order."""
        return sorted({r for door in self.plan.doors if room in door.rooms for r in door.rooms if r != room})


def make_building(
    seed: int | np.random.Generator,
    *,
    clutter: float = 1.0,
    skew: float = 0.0,
    num_rows: int = 3,
    width: float | None = None,
    height: float | None = None,
) -> Building:
    """Draw a building of `num_rows` rows of rooms; the corridor, if there is one, is a further row.

    Args:
        seed: Same seed, same building.
        clutter: Amount of furniture, 0 for none, 1 for about three pieces in a room of 20 m².
        skew: Tangent of the largest angle by which walls lean away from right angles.
        num_rows: Rows of rooms.
        width: Length of the rows [m]; None draws 15 to 25.
        height: Height of the rooms [m]; None draws 2.5 to 3.
    """
    rng = np.random.default_rng(seed)
    width = float(rng.uniform(15.0, 25.0)) if width is None else width
    # The order of draws is part of what a seed means: another order would give other buildings for the same
    # seed.
    depths = list(rng.uniform(4.0, 6.0, num_rows))
    rooms = [list(rng.uniform(0.75, 1.3, max(round(width / rng.uniform(4.2, 6.0)), 1))) for _ in depths]
    corridor_row = None
    if num_rows > 1 and rng.random() < 0.5:
        # Never the first or last row: the corridor has rooms on both sides.
        corridor_row = int(rng.integers(1, num_rows))
        depths.insert(corridor_row, rng.uniform(1.7, 2.4))
        rooms.insert(corridor_row, [1.0])
    plan = make_plan(
        rng, width=width, row_depths=depths, room_widths=rooms, corridor_row=corridor_row, skew=skew
    )
    height = float(rng.uniform(2.5, 3.0)) if height is None else height
    pieces = [p for room in plan.rooms for p in furnish(rng, plan, room, height=height, clutter=clutter)]
    return _assemble(plan, height, pieces)


def make_hotel(
    seed: int | np.random.Generator,
    *,
    rooms_per_side: int = 4,
    clutter: float = 1.2,
    moved_share: float = 0.1,
) -> Building:
    """Draw a corridor with equal rooms on both sides, equally furnished but for a share of moved pieces.

    Rooms across the corridor are turned by 180 degrees.

    Args:
        seed: Same seed, same building.
        rooms_per_side: Rooms on each side of the corridor.
        clutter: Amount of furniture, as in `make_building`.
        moved_share: Share of the pieces that are replaced by others.
    """
    rng = np.random.default_rng(seed)
    room_width, depth = rng.uniform(3.2, 4.2), rng.uniform(4.5, 6.0)
    widths = [[1.0] * rooms_per_side, [1.0], [1.0] * rooms_per_side]
    plan = make_plan(
        rng,
        width=float(room_width * rooms_per_side),
        row_depths=[depth, rng.uniform(1.8, 2.3), depth],
        room_widths=widths,
        corridor_row=1,
        equal_rooms=True,
    )
    height = float(rng.uniform(2.5, 2.9))
    first = plan.rooms[0]
    # Rooms all but empty would be equal whatever is moved; the fullest of a few draws is taken.
    draws = [furnish(rng, plan, first, height=height, clutter=clutter) for _ in range(5)]
    template = max(draws, key=len)
    pieces = []
    for index, room in enumerate(plan.rooms):
        if room.is_corridor:
            continue
        sign = 1.0 if index < rooms_per_side else -1.0
        centre, new_centre = first.polygon.mean(axis=0), room.polygon.mean(axis=0)
        kept = [turned(piece, centre, new_centre, sign) for piece in template if rng.random() >= moved_share]
        pieces += kept
        # The replacements were drawn for an empty room, so those that stand in what was kept are left out.
        others = furnish(rng, plan, room, height=height, clutter=clutter)
        pieces += _clear_of(others, kept)[: len(template) - len(kept)]
    return _assemble(plan, height, pieces)


def close_doors(building: Building, rooms: list[int], rng: np.random.Generator, share: float) -> Building:
    """The building as a robot finds it that passes only doors between its own rooms.

    Args:
        building: A building with all doors open.
        rooms: The robot's rooms; doors between them stay open.
        rng: Source of chance.
        share: Probability that another door is closed.
    """
    panels = []
    for door in building.plan.doors:
        # A door between rooms of the robot takes no draw, because it stays open whatever chance says.
        if set(door.rooms) <= set(rooms) or rng.random() >= share:
            continue
        along = float(np.arctan2(-door.normal[0], door.normal[1]))
        # Wider than any door: what is too much lies inside the wall.
        panels.append((rectangle(door.centre, 1.1, 0.05, along), 0.0, DOOR_HEIGHT, "door"))
    return replace(building, solids=join_prisms(building.solids, make_prisms(panels)))


def _clear_of(pieces: list[list[Item]], kept: list[list[Item]]) -> list[list[Item]]:
    """Those pieces that stand well away from all kept ones."""

    def is_clear(piece: list[Item]) -> bool:
        return all(
            np.linalg.norm(piece[0].footprint.mean(axis=0) - other[0].footprint.mean(axis=0)) > 1.8
            for other in kept
        )

    return [piece for piece in pieces if is_clear(piece)]


def _assemble(plan: Plan, height: float, furniture: list[list[Item]]) -> Building:
    """Make the solids and find their corners."""
    slab_thickness = 0.25
    parts = [part for wall in plan.walls for part in _wall_parts(wall, height)]
    row_ends = np.asarray([p for wall in plan.walls for p in (wall.start, wall.end)])
    low, high = row_ends.min(axis=0) - WALL_THICKNESS, row_ends.max(axis=0) + WALL_THICKNESS
    # Floor and ceiling reach past the outer walls, so that no ray leaves along an edge.
    slab = rectangle(0.5 * (low + high), high[0] - low[0], high[1] - low[1], 0.0)
    parts += [(slab, -slab_thickness, 0.0, "floor"), (slab, height, height + slab_thickness, "ceiling")]
    parts += [(i.footprint, i.bottom, i.top, "furniture") for piece in furniture for i in piece]
    return Building(plan, height, furniture, make_prisms(parts), find_true_corners(plan, height, furniture))


def _wall_parts(wall: Wall, height: float) -> list[tuple[np.ndarray, float, float, str]]:
    """The wall cut into prisms around its openings; it reaches half its thickness past its ends."""
    u = wall.along
    yaw = float(np.arctan2(u[1], u[0]))
    length = float(np.linalg.norm(wall.end - wall.start))
    # Walls meet where their centre lines do, which alone would leave the outer corner open.
    half = 0.5 * WALL_THICKNESS
    parts = []

    def add(start: float, end: float, bottom: float, top: float) -> None:
        # A door has no sill, and openings may touch: prisms without volume are left out.
        if end - start > 1e-6 and top - bottom > 1e-6:
            centre = wall.start + 0.5 * (start + end) * u
            parts.append((rectangle(centre, end - start, WALL_THICKNESS, yaw), bottom, top, "wall"))

    done = -half
    for opening in sorted(wall.openings, key=lambda o: o.start):
        end = opening.start + opening.width
        add(done, opening.start, 0.0, height)
        add(opening.start, end, 0.0, opening.bottom)
        add(opening.start, end, opening.top, height)
        done = end
    add(done, length + half, 0.0, height)
    return parts
