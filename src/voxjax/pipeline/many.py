"""N maps to one: register the pairs, keep a spanning tree of what is trusted, chain the poses, fuse."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import equinox as eqx
import numpy as np

from .._checks import InputError
from .._runtime.threads import spread
from ..fusion.fuse import fuse
from ..grid import VoxelGrid
from ..metrics import pose_error
from ..registration.hypotheses.map_features import LateFeatures
from ..registration.types import Registration
from .config import Config, config_from
from .memory_need import check_register_memory
from .pair import prepare, register, register_prepared, working_voxel_size

Status = Literal["merged", "partial", "no_overlap"]
OnStage = Callable[..., None]


class LoopError(eqx.Module):
    """How far an accepted pair that the tree did not need disagrees with the poses of the tree.

    Attributes:
        a: Number of the first map.
        b: Number of the second map.
        metres: Distance between the two places of map b's centre [m].
        radians: Angle between the two rotations [rad].
    """

    a: int
    b: int
    metres: float
    radians: float


class Merge(eqx.Module):
    """Outcome of `voxjax.merge`.

    Attributes:
        grid: The fused map in the world frame; None when no two maps fit together.
        poses: One `T_world_map` (4, 4) float32 a map, or None where it fits none. World is the frame of the
            first map that was merged.
        pairs: (a, b, registration) for each pair that was tried, a < b.
        status: "merged" all maps, "partial" some of them, "no_overlap" none.
        loops: Disagreement of the accepted pairs outside the tree; empty with two maps.
        seconds: {stage: s}: "features", "register", "fuse" and their sum "total".
        late: Corners and descriptors of each map, computed when first asked for; None for a map without any, or where
            the preset computes its own.
    """

    grid: VoxelGrid | None
    poses: tuple[np.ndarray | None, ...]
    pairs: tuple[tuple[int, int, Registration], ...]
    status: Status
    loops: tuple[LoopError, ...]
    seconds: dict
    late: tuple[LateFeatures | None, ...]

    @property
    def reason(self) -> str:
        """One sentence for a person: what was merged, what was left out and why."""
        left_out = [number for number, pose in enumerate(self.poses) if pose is None]
        if self.status == "merged":
            return f"All {len(self.poses)} maps were merged."
        if self.status == "partial":
            names = ", ".join(map(str, left_out))
            return (
                f"{len(self.poses) - len(left_out)} of {len(self.poses)} maps were merged; left out: {names}."
            )
        closest = max(self.pairs, key=lambda pair: (pair[2].confidence, _best_score(pair[2])), default=None)
        return "No two maps fit together." if closest is None else closest[2].reason


def merge(
    grids: Sequence[VoxelGrid],
    *,
    preset: Literal["default", "paper"] = "default",
    rule: Literal["paper", "keep", "log_odds"] | None = None,
    gravity_aligned: bool = False,
    init_guess: object = None,
    config: Config | Mapping | None = None,
    on_stage: OnStage | None = None,
) -> Merge:
    """Merge two or more maps whose relative poses are unknown.

    Every pair is registered. The accepted pairs form a graph; its largest connected part is merged (of equal
    parts, the one with the lowest map number), along the spanning tree with the highest confidence. Maps
    outside it are left out and have the pose None.

    Args:
        grids: The maps, at least two.
        preset: "default", or "paper" for the published method alone.
        rule: How states are combined, see `voxjax.fuse`; None lets it choose.
        gravity_aligned: The z axes of all maps point up, so that only yaw is unknown.
        init_guess: With two maps, a (4, 4) `T_a_b` that is tried as one more hypothesis.
        config: Settings of the stages, see `voxjax.pipeline.config`.
        on_stage: Called with the name of each stage as it starts.

    Returns:
        The fused map, the poses and the registrations behind them.

    Raises:
        InputError: If there are fewer than two maps, a guess with more than two, or the maps or the fused one need more
            memory than there is (`pipeline/memory_need.py`, `fusion/fuse.py`).
    """
    if len(grids) < 2:
        raise InputError(f"merge needs at least two maps, got {len(grids)}.")
    if init_guess is not None and len(grids) != 2:
        raise InputError(
            f"init_guess is the pose of one pair, so it needs exactly two maps, got {len(grids)}."
        )
    settings, announce = config_from(config), on_stage or _silent
    options: dict[str, Any] = {
        "gravity_aligned": gravity_aligned,
        "init_guess": init_guess,
        "config": settings,
    }
    start = time.perf_counter()
    features = _features_of_all(grids, settings, announce) if preset == "default" else None
    prepared = time.perf_counter()
    pairs = []
    for a, b in itertools.combinations(range(len(grids)), 2):
        hook = None if on_stage is None else _named_hook(on_stage, f"maps {a} and {b}")
        if features is None or features[a] is None or features[b] is None:
            found = register(grids[a], grids[b], preset=preset, on_stage=hook, **options)
        else:
            found = register_prepared(features[a], features[b], on_stage=hook, **options)
        pairs.append((a, b, found))
    registered = time.perf_counter()

    tree = spanning_tree(len(grids), pairs)
    poses = chain_poses(len(grids), tree)
    chosen = [number for number, pose in enumerate(poses) if pose is not None]
    grid = None
    if chosen:
        announce("fuse")
        grid = fuse([grids[n] for n in chosen], [poses[n] for n in chosen], rule=rule)
    end = time.perf_counter()
    status: Status = "no_overlap" if not chosen else "merged" if len(chosen) == len(grids) else "partial"
    return Merge(
        grid=grid, poses=tuple(poses), pairs=tuple(pairs), status=status,
        loops=tuple(loop_errors(grids, poses, pairs, tree)),
        seconds={
            "features": prepared - start, "register": registered - prepared, "fuse": end - registered,
            "total": end - start,
        },
        late=tuple(None if f is None else f.late for f in features or [None] * len(grids)),
    )  # fmt: skip


def spanning_tree(
    num_maps: int, pairs: Sequence[tuple[int, int, Registration]]
) -> list[tuple[int, int, Registration]]:
    """The edges of the best tree over the largest part of the maps that accepted pairs connect.

    Edges are taken by confidence, then by evidence, then by map numbers (Kruskal), so the result does not
    depend on the order of `pairs`. Of parts of equal size, the one with the lowest map number is returned.
    """
    accepted = [pair for pair in pairs if pair[2].accepted]
    accepted.sort(key=lambda pair: (-pair[2].confidence, -_best_score(pair[2]), pair[0], pair[1]))
    part = list(range(num_maps))  # number of the part that each map belongs to: its lowest map
    kept = []
    for a, b, registration in accepted:
        low, high = sorted((part[a], part[b]))
        if low != high:
            part = [low if number == high else number for number in part]
            kept.append((a, b, registration))
    largest = max(range(num_maps), key=lambda number: (part.count(number), -number))
    return [edge for edge in kept if part[edge[0]] == largest]


def chain_poses(num_maps: int, tree: Sequence[tuple[int, int, Registration]]) -> list[np.ndarray | None]:
    """Poses `T_world_map` (4, 4) float32 of the maps in the tree; world is the frame of its lowest map."""
    poses: list[np.ndarray | None] = [None] * num_maps
    if not tree:
        return poses
    root = min(min(a, b) for a, b, _ in tree)
    exact = {root: np.eye(4)}
    waiting = list(tree)
    while waiting:
        a, b, registration = next(edge for edge in waiting if (edge[0] in exact) != (edge[1] in exact))
        T_a_b = np.asarray(registration.T_a_b, np.float64)
        if a in exact:
            exact[b] = exact[a] @ T_a_b
        else:
            exact[a] = exact[b] @ _inverse(T_a_b)
        waiting = [edge for edge in waiting if (edge[0], edge[1]) != (a, b)]
    for number, pose in exact.items():
        poses[number] = pose.astype(np.float32)
    return poses


def loop_errors(
    grids: Sequence[VoxelGrid],
    poses: Sequence[np.ndarray | None],
    pairs: Sequence[tuple[int, int, Registration]],
    tree: Sequence[tuple[int, int, Registration]],
) -> list[LoopError]:
    """How far each accepted pair outside the tree disagrees with the chained poses."""
    in_tree = {(a, b) for a, b, _ in tree}
    errors = []
    for a, b, registration in pairs:
        pose_a, pose_b = poses[a], poses[b]
        if not registration.accepted or (a, b) in in_tree or pose_a is None or pose_b is None:
            continue
        chained = _inverse(pose_a.astype(np.float64)) @ pose_b.astype(np.float64)
        direct = np.asarray(registration.T_a_b, np.float64)
        low, high = grids[b].extent
        error = pose_error(chained, direct, (low.astype(np.float64) + high) / 2.0)
        errors.append(LoopError(a=a, b=b, metres=error.metres, radians=float(np.radians(error.degrees))))
    return errors


def _features_of_all(grids: Sequence[VoxelGrid], settings: Config, announce: OnStage) -> list[Any]:
    """Features of each map, computed once for all its pairs; None for a map with nothing occupied."""
    filled = [grid for grid in grids if grid.num_occupied]
    if not filled:
        return [None] * len(grids)
    voxel_size = working_voxel_size(filled, settings)
    check_register_memory(filled, voxel_size)
    announce(f"features of {len(filled)} maps")

    def features_of(grid: VoxelGrid) -> Any:
        if grid.num_occupied == 0:
            return None
        return prepare(grid, voxel_size=voxel_size, infer_free_space=settings.map.infer_free_space)

    return spread(features_of, grids)


def _silent(stage: str) -> None:
    """Announce nothing."""


def _named_hook(on_stage: OnStage, prefix: str) -> OnStage:
    """A stage callback that puts the pair before the stage's name."""

    def hook(name: str, *rest: object) -> None:
        on_stage(f"{prefix}: {name}", *rest)

    return hook


def _best_score(registration: Registration) -> float:
    """Evidence of the best hypothesis; below everything when there is none."""
    return registration.hypotheses[0].score if registration.hypotheses else -np.inf


def _inverse(T: np.ndarray) -> np.ndarray:
    """Inverse of a rigid transform, in its own precision."""
    inverse = np.eye(4, dtype=T.dtype)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse
