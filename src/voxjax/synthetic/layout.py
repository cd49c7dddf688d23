"""Plans of buildings: rows of rooms between straight walls, doors and windows in them."""

from dataclasses import dataclass, field

import numpy as np

WALL_THICKNESS = 0.2
"""Thickness of all walls [m]."""

DOOR_HEIGHT = 2.05
"""Height of the lintels of doors [m]."""

_CORNER_CLEARANCE = 0.45  # no opening nearer to a corner of a room [m]


@dataclass(frozen=True)
class Opening:
    """A door or window in a wall.

    Attributes:
        start: Where it begins along the wall [m].
        width: Width of the opening [m].
        bottom: Height of its sill above the floor [m], 0 for a door.
        top: Height of its lintel [m].
    """

    start: float
    width: float
    bottom: float
    top: float


@dataclass
class Wall:
    """A straight wall, given by its centre line.

    Attributes:
        start: (2,) [m].
        end: (2,) [m].
        openings: Doors and windows, not overlapping.
    """

    start: np.ndarray
    end: np.ndarray
    openings: list[Opening] = field(default_factory=list)

    @property
    def along(self) -> np.ndarray:
        """Unit vector from start to end."""
        return (self.end - self.start) / np.linalg.norm(self.end - self.start)

    def is_open_near(self, start: float, width: float) -> bool:
        """Whether an opening lies within 0.3 m of the stretch."""
        return any(o.start - 0.3 < start + width and start < o.start + o.width + 0.3 for o in self.openings)


@dataclass(frozen=True)
class Room:
    """A room.

    Attributes:
        polygon: (4, 2) [m]: inner corners, counterclockwise, first the side toward smaller y.
        is_corridor: Whether it is the corridor.
    """

    polygon: np.ndarray
    is_corridor: bool


@dataclass(frozen=True)
class Door:
    """A door between two rooms.

    Attributes:
        rooms: Indices of the two rooms; it leads along `normal` from the first to the second.
        centre: (2,) [m].
        normal: Unit vector (2,) across the wall.
    """

    rooms: tuple[int, int]
    centre: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class Plan:
    """Walls, rooms, doors and windows of one storey.

    Attributes:
        walls: All walls.
        rooms: Row by row.
        doors: Between rooms.
        windows: Middle and half the width of each window, (3,) [m].
    """

    walls: list[Wall]
    rooms: list[Room]
    doors: list[Door]
    windows: list[np.ndarray]


def make_plan(
    rng: np.random.Generator,
    *,
    width: float,
    row_depths: list[float],
    room_widths: list[list[float]],
    corridor_row: int | None = None,
    skew: float = 0.0,
    equal_rooms: bool = False,
) -> Plan:
    """Draw a plan.

    Args:
        rng: Source of chance.
        width: Length of the rows [m].
        row_depths: Depth of each row of rooms [m].
        room_widths: For each row the widths of its rooms; they are scaled to fill the row.
        corridor_row: Which row is the corridor.
        skew: How far walls lean away from right angles: tangent of the largest angle.
        equal_rooms: Doors only to the corridor and at the same place of each room.
    """
    # Walls are lines through the whole building or through a row, and rooms are what lies between four of them: they
    # close at any angles.
    shear = skew * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
    edges = np.concatenate([[0.0], np.cumsum(row_depths)])
    slopes = 0.4 * skew * rng.uniform(-1.0, 1.0, len(edges))
    row_lines = [
        (np.asarray([0.5 * width, y]), np.asarray([1.0, s])) for y, s in zip(edges, slopes, strict=True)
    ]
    rows = []
    for row, widths in enumerate(room_widths):
        places = np.concatenate([[0.0], np.cumsum(widths)]) * width / np.sum(widths)
        lean = np.full(len(places), shear)
        # The first and the last wall of each row lean alike, so that the building's two ends are straight.
        lean[1:-1] += 0.3 * skew * rng.uniform(-1.0, 1.0, len(places) - 2)
        middle = 0.5 * (edges[row] + edges[row + 1])
        rows.append(
            [
                (np.asarray([x + shear * middle, middle]), np.asarray([a, 1.0]))
                for x, a in zip(places, lean, strict=True)
            ]
        )
    return _PlanBuilder(rng, row_lines, rows, corridor_row, equal_rooms).build()


def intersect(line_a: tuple, line_b: tuple) -> np.ndarray:
    """Where two lines (point, direction) of the plane meet."""
    (p, u), (q, v) = line_a, line_b
    s = np.linalg.solve(np.stack([u, -v], axis=1), q - p)[0]
    return p + s * u


def _shifted(line: tuple, distance: float) -> tuple:
    """The line moved to its left."""
    point, u = line
    return point + distance * np.asarray([-u[1], u[0]]) / np.linalg.norm(u), u


class _PlanBuilder:
    """Holds the lines while walls, rooms and openings are made from them."""

    def __init__(self, rng, row_lines, rows, corridor_row, equal_rooms):
        self.rng, self.row_lines, self.rows = rng, row_lines, rows
        self.corridor_row, self.equal_rooms = corridor_row, equal_rooms
        self.row_walls = [
            Wall(
                intersect(line, rows[min(j, len(rows) - 1)][0]),
                intersect(line, rows[min(j, len(rows) - 1)][-1]),
            )
            for j, line in enumerate(row_lines)
        ]
        self.column_walls = [
            [Wall(intersect(c, row_lines[j]), intersect(c, row_lines[j + 1])) for c in columns]
            for j, columns in enumerate(rows)
        ]
        self.rooms, self.place = [], {}
        for j, columns in enumerate(rows):
            for k in range(len(columns) - 1):
                self.place[j, k] = len(self.rooms)
                self.rooms.append(Room(self._inner_polygon(j, k), j == corridor_row))

    def build(self) -> Plan:
        """Cut doors and windows and return the plan."""
        # Windows take what place the doors leave: rooms must be reached, and need not have a window.
        doors = self._cut_doors()
        windows = self._cut_windows()
        walls = [*self.row_walls, *(w for columns in self.column_walls for w in columns)]
        return Plan(walls, self.rooms, doors, windows)

    def _inner_polygon(self, j: int, k: int) -> np.ndarray:
        """Inner corners of room k of row j, half a wall inside the centre lines."""
        half = 0.5 * WALL_THICKNESS
        low, high = _shifted(self.row_lines[j], half), _shifted(self.row_lines[j + 1], -half)
        left, right = _shifted(self.rows[j][k], -half), _shifted(self.rows[j][k + 1], half)
        return np.asarray(
            [intersect(low, left), intersect(low, right), intersect(high, right), intersect(high, left)]
        )

    def _candidates(self) -> list[tuple[int, int, Wall, float, float]]:
        """Neighbouring rooms with the wall between them and the stretch that both have."""
        found = []
        for (j, k), room in self.place.items():
            if (j, k + 1) in self.place:
                wall = self.column_walls[j][k + 1]
                found.append(
                    (room, self.place[j, k + 1], wall, 0.0, float(np.linalg.norm(wall.end - wall.start)))
                )
            for (other_j, _), other in self.place.items():
                if other_j == j + 1:
                    wall = self.row_walls[j + 1]
                    below = (self.rooms[room].polygon[[3, 2]] - wall.start) @ wall.along
                    above = (self.rooms[other].polygon[[0, 1]] - wall.start) @ wall.along
                    low, high = max(below[0], above[0]), min(below[1], above[1])
                    # Rooms of neighbouring rows share a stretch of the wall, or none that has place for a door.
                    if high - low > 2 * _CORNER_CLEARANCE + 1.0:
                        found.append((room, other, wall, float(low), float(high)))
        return found

    def _cut_doors(self) -> list[Door]:
        """Doors along a random spanning tree (to the corridor first) and some more."""
        candidates = self._candidates()
        order = self.rng.permutation(len(candidates))
        if self.corridor_row is not None:
            # The sort is stable: doors to the corridor come first, and chance orders the rest as before.
            order = sorted(order, key=lambda i: not any(self.rooms[r].is_corridor for r in candidates[i][:2]))
        group = list(range(len(self.rooms)))
        doors = []
        for i in order:
            a, b, wall, low, high = candidates[i]
            # A room without a door could not be mapped, so doors that join two groups of rooms are always cut.
            is_needed = group[a] != group[b]
            if not is_needed and (self.equal_rooms or self.rng.random() > 0.1):
                continue
            door = self._cut_door(a, b, wall, low, high)
            if door is not None:
                doors.append(door)
                # Two groups of rooms are one from now on, as in Kruskal's algorithm.
                group = [group[a] if g == group[b] else g for g in group]
        return doors

    def _cut_door(self, a: int, b: int, wall: Wall, low: float, high: float) -> Door | None:
        """Cut one door where there is place."""
        # Doors of other rooms may have taken the stretch; after some tries the rooms stay without a door between them.
        for _ in range(20):
            width = 0.95 if self.equal_rooms else float(self.rng.uniform(0.8, 1.0))
            share = self._equal_place(b) if self.equal_rooms else float(self.rng.random())
            start = low + _CORNER_CLEARANCE + share * (high - low - 2 * _CORNER_CLEARANCE - width)
            if not wall.is_open_near(start, width):
                wall.openings.append(Opening(start, width, 0.0, DOOR_HEIGHT))
                u = wall.along
                centre = wall.start + (start + 0.5 * width) * u
                normal = np.asarray([-u[1], u[0]])
                towards_b = np.sign(normal @ (self.rooms[b].polygon.mean(axis=0) - centre))
                return Door((a, b), centre, normal * towards_b)
        return None

    def _equal_place(self, room_after: int) -> float:
        """Where the door sits in equal rooms: those after the corridor are turned by 180 degrees."""
        return 0.8 if self.rooms[room_after].is_corridor else 0.2

    def _cut_windows(self) -> list[np.ndarray]:
        """Windows in about every third outer wall of a room."""
        windows = []
        last = len(self.rows) - 1
        for (j, k), room in self.place.items():
            polygon = self.rooms[room].polygon
            outer = []
            if j == 0:
                outer.append((self.row_walls[0], polygon[[0, 1]]))
            if j == last:
                outer.append((self.row_walls[-1], polygon[[3, 2]]))
            if k == 0:
                outer.append((self.column_walls[j][0], polygon[[0, 3]]))
            if (j, k + 1) not in self.place:
                outer.append((self.column_walls[j][-1], polygon[[1, 2]]))
            for wall, ends in outer:
                # Equal rooms have no windows, which would tell them apart.
                if self.rng.random() < (0.0 if self.equal_rooms else 0.35):
                    windows += self._cut_window(wall, ends)
        return windows

    def _cut_window(self, wall: Wall, ends: np.ndarray) -> list[np.ndarray]:
        """One window between the inner corners `ends`, if there is place."""
        low, high = (ends - wall.start) @ wall.along
        width = min(float(self.rng.uniform(0.8, 1.8)), high - low - 2 * _CORNER_CLEARANCE)
        start = low + _CORNER_CLEARANCE + self.rng.random() * (high - low - 2 * _CORNER_CLEARANCE - width)
        # All draws are made before this, so that a window that is refused does not shift what comes after it.
        if width <= 0.5 or wall.is_open_near(start, width):
            return []
        wall.openings.append(Opening(float(start), width, 0.9, 2.1))
        middle = wall.start + (start + 0.5 * width) * wall.along
        return [np.asarray([*middle, 0.5 * width])]
