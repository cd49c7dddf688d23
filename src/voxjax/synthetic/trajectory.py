"""Ways through generated buildings: from room to room through the doors, and how poses drift on them."""

import numpy as np

from .building import Building
from .layout import Door


def choose_rooms(
    rng: np.random.Generator, building: Building, *, num_robots: int, overlap: float
) -> tuple[list[list[int]], list[int]]:
    """Share the rooms out: a connected part for all robots, and the rest to one robot each.

    Args:
        rng: Source of chance.
        building: Building whose rooms are walked through.
        num_robots: Number of robots.
        overlap: Share of the rooms that every robot visits; at least one room is shared.

    Returns:
        The rooms of each robot, sorted, and the shared ones.
    """
    draws = [_share_out(rng, building, num_robots, overlap) for _ in range(8)]
    # A fair draw gives the robot with the fewest rooms as many as can be.
    return max(draws, key=lambda draw: min(len(rooms) for rooms in draw[0]))


def _share_out(
    rng: np.random.Generator, building: Building, num_robots: int, overlap: float
) -> tuple[list[list[int]], list[int]]:
    """One draw: grow the shared part, then the robots' own parts in turns until no room can be reached."""
    num_shared = int(np.clip(np.ceil(overlap * building.num_rooms - 1e-9), 1, building.num_rooms))
    shared = {int(rng.integers(building.num_rooms))}
    while len(shared) < num_shared:
        shared.add(_pick_neighbour(rng, building, shared, shared))
    robots = [set(shared) for _ in range(num_robots)]
    taken, stuck = set(shared), 0
    turn = int(rng.integers(num_robots))
    # In turns, so that the parts grow alike; a robot whose part is walled in by those of others passes.
    while stuck < num_robots:
        room = _pick_neighbour(rng, building, robots[turn], taken)
        stuck = stuck + 1 if room < 0 else 0
        if room >= 0:
            robots[turn].add(room)
            taken.add(room)
        turn = (turn + 1) % num_robots
    return [sorted(rooms) for rooms in robots], sorted(shared)


def _pick_neighbour(rng: np.random.Generator, building: Building, own: set[int], taken: set[int]) -> int:
    """A room not taken with a door to one of `own`, -1 if there is none."""
    free = sorted({n for room in own for n in building.neighbours(room)} - taken)
    return int(rng.choice(free)) if free else -1


def walk_rooms(
    rng: np.random.Generator, building: Building, rooms: list[int], *, step: float = 0.9
) -> np.ndarray:
    """A way through the rooms, as sensor poses about `step` [m] apart.

    Args:
        rng: Source of chance.
        building: Building in which the robot walks.
        rooms: Rooms to visit, joined by doors.
        step: Distance between poses [m].

    Returns:
        (n, 4, 4): `T_world_sensor`, heading along the way, with a degree of roll and pitch.
    """
    height = rng.uniform(0.9, 1.3)
    corners = np.asarray(visit_rooms(rng, building, rooms))
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    # Poses are set by length along the way, so that they are as dense in long legs as in short ones.
    places = np.arange(0.0, along[-1], step)
    way = np.stack([np.interp(places, along, corners[:, axis]) for axis in range(2)], axis=-1)
    ahead = np.stack([np.interp(places + 0.2, along, corners[:, axis]) for axis in range(2)], axis=-1) - way
    points = np.concatenate([way, np.full((len(way), 1), height)], axis=1)
    # The way leads through furniture too, where no sensor can stand.
    is_clear = building.solids.distance(points).min(axis=1) > 0.25
    tilt = rng.normal(0.0, np.radians(1.0), (len(way), 2))
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses = np.asarray([pose_of(p, [a, b, c]) for p, (a, b), c in zip(points, tilt, yaw, strict=True)])
    return poses[is_clear]


def visit_rooms(rng: np.random.Generator, building: Building, rooms: list[int]) -> list[np.ndarray]:
    """Points (2,) of a depth-first walk through the rooms; it comes back only while rooms are left."""
    left = set(rooms)
    start = int(rng.choice(rooms))
    points: list[np.ndarray] = []

    def enter(room: int) -> None:
        left.discard(room)
        points.extend(_points_inside(rng, building.plan.rooms[room].polygon))
        for door in rng.permutation(len(building.plan.doors)):
            way = building.plan.doors[door]
            if room not in way.rooms:
                continue
            other = way.rooms[1] if way.rooms[0] == room else way.rooms[0]
            if other in left:
                points.extend(_through(way, room))
                enter(other)
                # Nobody walks back from the last room, where nothing is left to see.
                if left:
                    points.extend(_through(way, other))

    enter(start)
    return points


def pose_of(position: np.ndarray, roll_pitch_yaw: np.ndarray | list[float]) -> np.ndarray:
    """Pose (4, 4) of a position and of roll, pitch and yaw [rad] about fixed x, y, z."""
    (sa, sb, sc), (ca, cb, cc) = np.sin(roll_pitch_yaw), np.cos(roll_pitch_yaw)
    about_x = np.asarray([[1.0, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.asarray([[cb, 0, sb], [0, 1.0, 0], [-sb, 0, cb]])
    about_z = np.asarray([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1.0]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = about_z @ about_y @ about_x, position
    return T


def draw_drift(rng: np.random.Generator, poses: np.ndarray, amount: float) -> np.ndarray:
    """Errors of the poses that a mapper believes in: smooth along the way.

    Args:
        rng: Source of chance.
        poses: (n, 4, 4) true poses.
        amount: Standard deviation of the position [m]; angles err by 0.1 rad a metre of it, height by half.

    Returns:
        (n, 4, 4): the poses with their errors.
    """
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    # Three slow waves a component, of wavelengths from 12 to 60 m.
    waves = 2.0 * np.pi / rng.uniform(12.0, 60.0, (6, 3))
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, 3))
    smooth = np.sin(along[:, None, None] * waves + phases).sum(axis=-1) * np.sqrt(2.0 / 3.0)
    # Gravity shows roll and pitch to a mapper, so that they err less than yaw.
    error = smooth * amount * np.asarray([1.0, 1.0, 0.5, 0.03, 0.03, 0.1])
    drifted = poses.copy()
    for T, e in zip(drifted, error, strict=True):
        T[:3, :3] = pose_of(np.zeros(3), e[3:])[:3, :3] @ T[:3, :3]
        T[:3, 3] += e[:3]
    return drifted


def _through(door: Door, from_room: int) -> list[np.ndarray]:
    """Points before, in and behind a door."""
    sign = 1.0 if from_room == door.rooms[0] else -1.0
    return [door.centre + s * sign * door.normal for s in (-0.7, 0.0, 0.7)]


def _points_inside(rng: np.random.Generator, polygon: np.ndarray) -> list[np.ndarray]:
    """Points well inside a room, one for about every 10 m², at least two, along its longer side."""
    a, b, c, d = polygon
    long_way = np.linalg.norm(b - a) > np.linalg.norm(d - a)
    size = np.linalg.norm(b - a) * np.linalg.norm(d - a)
    count = max(round(size / 10.0), 2)
    shares = (np.arange(count) + rng.uniform(0.25, 0.75, count)) / count
    if rng.random() < 0.5:
        shares = shares[::-1]
    across = rng.uniform(0.25, 0.75, count)
    pairs = zip(shares, across, strict=True) if long_way else zip(across, shares, strict=True)
    return [(1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * d + s * c) for s, t in pairs]
