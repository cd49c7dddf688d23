"""Generated pairs for the benchmarks: one building seen twice, different buildings, equal rooms.

Kinds and frames take turns, the rest is drawn from the seed and the pair's number: other seeds share no map.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxjax import VoxelGrid
from voxjax.synthetic import Team, different_buildings, simulate_hotel, simulate_team
from voxjax.synthetic.building import make_building

KINDS = ("pair", "pair", "hotel", "pair", "none", "pair", "pair", "hotel", "pair", "none")
"""Kinds of pairs in the order in which they take turns."""

FRAMES = ("yaw", "tilt", "so3")
"""How frames of maps lie to each other: turned about z, leaning by some degrees as well, turned in any way."""


@dataclass(frozen=True)
class MapPair:
    """Two maps and what is known of them.

    Attributes:
        a: First map.
        b: Second map.
        T_a_b: (4, 4) true pose, None where there is none.
        overlap: Share of the occupied voxels of one map that lie on the other under the truth; the smaller of both
            ways, 0 where there is no truth.
    """

    a: VoxelGrid
    b: VoxelGrid
    T_a_b: np.ndarray | None
    overlap: float

    @property
    def centroid_of_b(self) -> np.ndarray:
        """Centroid of map b's occupied voxels [m], where errors of position are made and measured."""
        return self.b.occupied_points().mean(axis=0, dtype=np.float64)


@dataclass(frozen=True)
class PairCase:
    """One generated pair; the maps are made when they are asked for.

    Attributes:
        name: Unique name, which holds the seed and the number.
        kind: "pair", "none" (different buildings) or "hotel" (equal rooms).
        frame: How the maps' frames lie: "yaw", "tilt" or "so3".
        voxel_size: Edge of the voxels of both maps [m].
        options: Options of the simulation that were drawn.
        make: Function that gives the maps and the truth.
    """

    name: str
    kind: str
    frame: str
    voxel_size: float
    options: dict[str, Any]
    make: Callable[[], MapPair]


def pair_case(seed: int, number: int) -> PairCase:
    """The pair of that number of a seed; any ten numbers in a row have six of one building, two of each other kind."""
    world_seed = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    rng = np.random.default_rng([seed, number, 1])
    # The turn of frames is slower than that of kinds, so that each kind meets each frame.
    kind, frame = KINDS[number % len(KINDS)], FRAMES[(number + number // len(KINDS)) % len(FRAMES)]
    options: dict[str, Any] = {
        "frame": frame,
        "voxel_size": float(rng.choice((0.1, 0.1, 0.1, 0.2))),
        "drift": round(float(rng.uniform(0.01, 0.06)), 4),
    }
    if kind == "hotel":
        options |= {"rooms_per_side": int(rng.integers(4, 7)), "shared_columns": int(rng.integers(1, 5))}
        simulate = simulate_hotel
    else:
        # Few rooms in common are drawn more often: maps overlap by far more than the share of rooms, for robots look
        # through doors, map both sides of walls and miss rooms. Only large buildings give overlaps below 0.2.
        is_large = number % len(KINDS) in (1, 3, 6)
        options |= {
            "overlap": round(0.02 + 0.58 * float(rng.random()) ** 2 * (0.5 if is_large else 1.0), 3),
            "clutter": round(float(rng.uniform(0.4, 2.0)), 3),
            "skew": float(rng.choice((0.0, 0.15, 0.3))),
        }
        if is_large:
            options |= {"width": round(float(rng.uniform(26.0, 34.0)), 2), "num_rows": 4}
        simulate = different_buildings if kind == "none" else _one_building

    def make() -> MapPair:
        return _as_pair(simulate(world_seed, **options))

    name = f"generated/{kind}_{seed}_{number}"
    return PairCase(name, kind, frame, options["voxel_size"], options, make)


def _one_building(seed: int, *, width: float | None = None, num_rows: int = 3, **options: Any) -> Team:
    """Two robots in one building of that width [m] and so many rows of rooms."""
    shape = {"clutter": options.pop("clutter"), "skew": options.pop("skew")}
    building = make_building(np.random.default_rng([seed, 0]), width=width, num_rows=num_rows, **shape)
    return simulate_team(seed, building=building, **options)


def _as_pair(team: Team) -> MapPair:
    overlap = min(team.overlap(0, 1), team.overlap(1, 0))
    return MapPair(team.grids[0], team.grids[1], team.true_pose(0, 1), overlap)
