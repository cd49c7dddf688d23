"""Teams of robots that map one generated building, each in its own frame, with the truth beside the maps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from .. import rigid
from .._checks import InputError
from ..grid import VoxelGrid
from .building import Building, close_doors, make_building, make_hotel
from .lidar import Lidar, take_scan
from .mapping import build_map
from .observed import observed_corners
from .trajectory import choose_rooms, draw_drift, walk_rooms
from .true_corners import TrueCorners

Frame = Literal["yaw", "tilt", "so3"]


@dataclass(frozen=True)
class Team:
    """Maps and their truth.

    Attributes:
        grids: One map a robot, each in its own frame.
        poses: (4, 4) `T_world_map` of each map, None for a stranger's.
        corners: True corners of the building, in the world's frame.
        is_observed: bool (robots, corners): which corners each map shows; all False for strangers.
        rooms: The rooms that each robot visited; a stranger's are those of its own building.
        shared_rooms: The rooms that all but the strangers visited.
        building: The building.
    """

    grids: tuple[VoxelGrid, ...]
    poses: tuple[np.ndarray | None, ...]
    corners: TrueCorners
    is_observed: np.ndarray
    rooms: tuple[list[int], ...]
    shared_rooms: list[int]
    building: Building

    def true_pose(self, a: int, b: int) -> np.ndarray | None:
        """`T_a_b` (4, 4): maps points of map b into map a; None where there is none."""
        T_world_a, T_world_b = self.poses[a], self.poses[b]
        if T_world_a is None or T_world_b is None:
            return None
        return rigid.inverse(T_world_a) @ T_world_b

    def overlap(self, a: int, b: int) -> float:
        """Share of the occupied voxels of b within 1.5 voxels of one of a; 0 for strangers."""
        T_a_b = self.true_pose(a, b)
        return 0.0 if T_a_b is None else measure_overlap(self.grids[a], self.grids[b], T_a_b)


def simulate_team(
    seed: int,
    *,
    num_robots: int = 2,
    num_strangers: int = 0,
    overlap: float = 0.5,
    frame: Frame = "yaw",
    voxel_size: float = 0.1,
    drift: float = 0.03,
    clutter: float = 1.0,
    skew: float = 0.0,
    closed_doors: float = 0.6,
    building: Building | None = None,
    rooms: Sequence[Sequence[int]] | None = None,
    lidar: Lidar | None = None,
) -> Team:
    """Let robots map a generated building.

    Args:
        seed: Same seed and options, same maps.
        num_robots: Robots in the building.
        num_strangers: Further robots, each in another building.
        overlap: Share of the rooms that all robots visit; the others are shared out among them. The maps overlap
            by more than that, for robots look through doors; `Team.overlap` measures it.
        frame: How the maps' frames lie: turned about the vertical, also tilted by up to 8 degrees, or anyhow.
        voxel_size: Voxel size of the maps [m].
        drift: Standard deviation of the positions that the mapper believes in [m].
        clutter: Amount of furniture; 1 is about three pieces in a room of 20 m².
        skew: Tangent of the largest angle by which walls lean away from right angles.
        closed_doors: Share of the doors that a robot finds closed, of those that it does not pass.
        building: None draws one.
        rooms: The rooms that each robot visits, joined by doors; None draws them by `overlap`.
        lidar: None takes the default with a noise of 1 to 3 cm.
    """
    # The building (0), the robots (1) and each stranger's building (2 and on) have streams of chance of their own, so
    # that the robots draw the same whether the building is given or made here.
    rng = np.random.default_rng([seed, 1])
    if building is None:
        building = make_building(np.random.default_rng([seed, 0]), clutter=clutter, skew=skew)
    if rooms is None:
        visits, shared = choose_rooms(rng, building, num_robots=num_robots, overlap=overlap)
    else:
        visits = [sorted(visited) for visited in rooms]
        shared = sorted(set.intersection(*map(set, visits)))
    places = [(building, visited) for visited in visits]
    for stranger in range(num_strangers):
        other = make_building(np.random.default_rng([seed, 2 + stranger]), clutter=clutter, skew=skew)
        # A stranger visits what one of two robots would, so that its map is as large as those it is compared with.
        places.append((other, choose_rooms(rng, other, num_robots=2, overlap=overlap)[0][0]))
    if lidar is None:
        lidar = Lidar(range_noise=float(rng.uniform(0.01, 0.03)))
    grids, poses = [], []
    for where, visited in places:
        T_world_map = draw_frame(rng, frame)
        # Open doors would show a robot the rooms of the others, and few pairs would overlap little.
        found = close_doors(where, visited, rng, closed_doors)
        grids.append(_map_rooms(rng, found, visited, T_world_map, voxel_size, drift, lidar))
        poses.append(T_world_map if where is building else None)
    corners = building.corners
    is_observed = np.stack([observed_corners(corners, g, T) for g, T in zip(grids, poses, strict=True)])
    visits = tuple(visited for _, visited in places)
    return Team(tuple(grids), tuple(poses), corners, is_observed, visits, shared, building)


def different_buildings(seed: int, **options) -> Team:
    """Two maps of different buildings; the options are those of `simulate_team`."""
    return simulate_team(seed, num_robots=1, num_strangers=1, **options)


def simulate_hotel(
    seed: int,
    *,
    rooms_per_side: int = 4,
    moved_share: float = 0.1,
    overlap: float = 0.4,
    shared_columns: int | None = None,
    **options,
) -> Team:
    """Robots in a building of equal rooms, where shifted maps agree almost as well as true ones.

    Args:
        seed: Same seed and options, same maps.
        rooms_per_side: Rooms on each side of the corridor.
        moved_share: Share of the furniture that differs from room to room.
        overlap: Share of the rooms that all robots visit.
        shared_columns: Instead of `overlap`, for two robots: one maps the columns of rooms from the left on, one from
            the right on, and so many columns in the middle are mapped by both.
        **options: Those of `simulate_team`, but `building`, `clutter` and `skew`.

    Raises:
        InputError: If there are fewer columns than are to be shared.
    """
    rng = np.random.default_rng([seed, 0])
    hotel = make_hotel(rng, rooms_per_side=rooms_per_side, moved_share=moved_share)
    if shared_columns is not None:
        if not 1 <= shared_columns <= rooms_per_side:
            raise InputError(
                f"shared_columns must be 1 to {rooms_per_side} (rooms_per_side), got {shared_columns}."
            )
        num_left = (rooms_per_side + shared_columns + 1) // 2
        columns = range(num_left), range(num_left - shared_columns, rooms_per_side)
        # Rooms are numbered row by row, the corridor, row number 1, being one room.
        options["rooms"] = [
            [*part, rooms_per_side, *(rooms_per_side + 1 + column for column in part)] for part in columns
        ]
    return simulate_team(seed, building=hotel, overlap=overlap, **options)


def draw_frame(rng: np.random.Generator, frame: Frame) -> np.ndarray:
    """A random `T_world_map` (4, 4), its origin within 15 m of the world's."""
    T = np.eye(4)
    T[:3, 3] = rng.uniform(-15.0, 15.0, 3)
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    if frame == "yaw":
        T[:3, :3] = yaw.as_matrix()
    elif frame == "tilt":
        direction, angle = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(2.0, 8.0))
        lean = Rotation.from_rotvec(angle * np.asarray([np.cos(direction), np.sin(direction), 0.0]))
        # The lean comes first and the yaw after it, so that the direction of the lean is turned as well.
        T[:3, :3] = (yaw * lean).as_matrix()
    else:
        T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    return T


def measure_overlap(a: VoxelGrid, b: VoxelGrid, T_a_b: np.ndarray) -> float:
    """Share of the occupied voxel centres of b within 1.5 voxels of one of a, under `T_a_b`.

    Of two voxel sizes the wider counts.
    """
    points = b.occupied_points().astype(np.float64) @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    # The bound spares the search for the far voxels of b, whose distance is given as infinite then.
    distance, _ = KDTree(a.occupied_points()).query(
        points, distance_upper_bound=1.5 * max(a.voxel_size, b.voxel_size)
    )
    return float(np.isfinite(distance).mean()) if len(points) else 0.0


def _map_rooms(
    rng: np.random.Generator,
    building: Building,
    rooms: list[int],
    T_world_map: np.ndarray,
    voxel_size: float,
    drift: float,
    lidar: Lidar,
) -> VoxelGrid:
    """Walk, scan and map."""
    true_poses = walk_rooms(rng, building, rooms)
    # Scans are taken from the true poses and put together at those that the mapper believes in: that is drift.
    scans = [take_scan(rng, building.scene, T, lidar) for T in true_poses]
    believed = draw_drift(rng, true_poses, drift)
    return build_map(scans, rigid.inverse(T_world_map) @ believed, voxel_size=voxel_size)
