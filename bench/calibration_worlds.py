"""Generated worlds that the verdict is fitted and tested on: pairs of one building, of equal rooms, other buildings."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

import voxjax as vx
from bench.worlds import FRAMES
from voxjax._types import FREE, UNKNOWN
from voxjax.synthetic import simulate_hotel, simulate_team

KINDS = {"pair": (0, 1, 4), "hotel": (2,), "build": (3,)}
"""For each kind, the rests after division by five of the seeds that belong to it; no seed serves two kinds."""


def make_world(seed: int, kind: str) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
    """Maps of a seed and their true pose: a "pair" of one building, a "hotel", or one map of a "build"ing."""
    rng = np.random.default_rng([seed, 99])
    frame = FRAMES[seed % 3]
    clutter, skew = float(rng.uniform(0.3, 2.0)), float(rng.choice([0, 0.15, 0.3]))
    drift = float(rng.uniform(0.02, 0.06))
    plain: dict[str, Any] = {"frame": frame, "clutter": clutter, "skew": skew, "drift": drift}
    if kind == "pair":
        team = simulate_team(seed, overlap=float(rng.choice((0.1, 0.2, 0.3, 0.45, 0.65))), **plain)
    elif kind == "hotel":
        team = simulate_hotel(
            seed,
            frame=frame,
            drift=drift,
            rooms_per_side=int(rng.integers(4, 7)),
            shared_columns=int(rng.integers(1, 5)),
        )
    else:
        team = simulate_team(seed, num_robots=1, overlap=float(rng.choice([0.4, 0.65])), **plain)
    return list(team.grids), team.true_pose(0, 1) if len(team.grids) == 2 else None


def load_world(seed: int, kind: str, cache: Path | None) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
    """Maps of a seed and their true pose, from the cache if they are there; see `make_world`."""
    path = None if cache is None else cache / f"{kind}_{seed}.npz"
    if path is not None and path.exists():
        with np.load(path) as kept:
            count = 2 if "s1" in kept else 1
            grids = [vx.VoxelGrid(kept[f"s{i}"], kept[f"o{i}"], float(kept[f"v{i}"])) for i in range(count)]
            return grids, kept["T"] if "T" in kept else None
    grids, T = make_world(seed, kind)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        parts: dict[str, Any] = {}
        for i, g in enumerate(grids):
            parts |= {f"s{i}": g.states, f"o{i}": g.origin, f"v{i}": g.voxel_size}
        if T is not None:
            parts["T"] = T
        np.savez_compressed(path, **parts)
    return grids, T


def seeds_of(kind: str, count: int, first: int) -> list[int]:
    """The first seeds of a kind from `first` on."""
    return list(itertools.islice((first + i for i in itertools.count() if i % 5 in KINDS[kind]), count))


def without_free_space(grid: vx.VoxelGrid) -> vx.VoxelGrid:
    """The map as a cloud of points gives it: nothing is known to be free."""
    states = np.asarray(grid.states)
    return vx.VoxelGrid(np.where(states == FREE, UNKNOWN, states), grid.origin, grid.voxel_size)
