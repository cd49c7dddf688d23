"""Generated pairs for the benchmarks: one building seen twice, different buildings, equal rooms."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from voxjax import VoxelGrid
from voxjax.synthetic import Team, different_buildings, simulate_hotel, simulate_team

KINDS = ("pair", "pair", "pair", "none", "pair", "none", "pair", "hotel")
FRAMES = ("yaw", "tilt", "so3")
OVERLAPS = (0.2, 0.4, 0.65)


@dataclass(frozen=True)
class PairCase:
    """One generated pair; the maps are made when they are asked for.

    Attributes:
        name: With the seed.
        kind: "pair", "none" (different buildings) or "hotel" (equal rooms).
        make: Gives the maps and the truth `T_a_b`, None where there is none.
    """

    name: str
    kind: str
    make: Callable[[], tuple[VoxelGrid, VoxelGrid, np.ndarray | None]]


def pair_case(seed: int) -> PairCase:
    """The pair of a seed: kinds, frames and overlaps take turns, so that any run of eight seeds has each kind."""
    kind, frame = KINDS[seed % len(KINDS)], FRAMES[seed // len(KINDS) % len(FRAMES)]
    overlap = OVERLAPS[seed // 3 % len(OVERLAPS)]
    options = {"frame": frame, "clutter": 0.4 + 0.16 * (seed % 10), "skew": (0.0, 0.15, 0.3)[seed % 3]}

    def make() -> tuple[VoxelGrid, VoxelGrid, np.ndarray | None]:
        if kind == "none":
            a, b = different_buildings(seed, **options).grids
            return a, b, None
        if kind == "hotel":
            return _with_truth(simulate_hotel(seed, frame=frame, overlap=overlap))
        return _with_truth(simulate_team(seed, overlap=overlap, **options))

    return PairCase(f"generated/{kind}_{seed}", kind, make)


def _with_truth(team: Team) -> tuple[VoxelGrid, VoxelGrid, np.ndarray]:
    T_world_a, T_world_b = team.poses[:2]
    assert T_world_a is not None
    assert T_world_b is not None
    return team.grids[0], team.grids[1], np.linalg.inv(T_world_a) @ T_world_b
