"""N maps to one: register the pairs, keep a spanning tree of what is trusted, chain the poses, fuse."""

import itertools
import os
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np

from .._checks import InputError
from .._runtime.forks import refused_after_fork
from .._runtime.threads import spread
from ..fusion.fuse import fuse
from ..fusion.rules import chosen_rule
from ..fusion.stored import check_memory_of_processes, check_processes
from ..grid import VoxelGrid, check_grids
from ..registration.hypotheses.map_features import MapFeatures
from .config import Config, config_from
from .features import WorkingVoxel, features_at, working_voxel
from .memory_need import check_register_memory
from .merged import Merge, Status
from .pair import register, register_features
from .pose_graph import chain_poses, loop_errors, spanning_tree
from .stage_times import OnStage, Stages
from .units import in_feet, in_odd_units


@refused_after_fork
def merge(
    grids: Sequence[VoxelGrid],
    *,
    preset: Literal["default", "paper"] = "default",
    rule: Literal["paper", "keep", "log_odds"] | None = None,
    gravity_aligned: bool = False,
    allow_changes: bool = False,
    init_guess: object = None,
    config: Config | Mapping | None = None,
    on_stage: OnStage | None = None,
    out: str | os.PathLike | None = None,
    num_processes: int = 1,
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
        allow_changes: Accept poses although things were moved between the maps, see `voxjax.register`.
        init_guess: A (4, 4) `T_a_b` that is tried as one more hypothesis; for two maps only.
        config: Settings of the stages, see `voxjax.pipeline.config`.
        on_stage: Called with the name of each stage as it starts.
        out: Name of a Zarr store that the fused map is written to, see `voxjax.fuse`; None keeps it in memory.
        num_processes: How many processes share the fusion into `out`, see `voxjax.fuse`.

    Returns:
        The fused map, the poses and the registrations behind them.

    Raises:
        InputError: If `grids` is no list of maps, there are fewer than two, a guess with more than two, the rule is not
            known, or the maps or the fused one need more memory than there is (`pipeline/memory_need.py`,
            `fusion/fuse.py`).
    """
    grids = check_grids("grids", grids)
    _check(grids, init_guess)
    # `fuse` would say so too, but after all pairs.
    num_processes = check_processes(num_processes, out)
    check_memory_of_processes(num_processes, len(grids), chosen_rule(rule, grids))
    settings, stages = config_from(config), Stages(on_stage)
    start = time.perf_counter()

    # 1. Features of each map, once for all its pairs; the paper's method computes its own.
    with stages.measure("features"):
        # A working voxel size is one for all maps here, whereas `register` takes that of its pair: features are
        # then made once.
        features, voxel = [None] * len(grids), None
        if preset == "default":
            features, voxel = _features_of_all(grids, settings, stages)

    # 2. Every pair on its own.
    pairs = []
    with stages.measure("register"):
        # All pairs are tried, not only as many as a tree needs: which of them overlap is not known, and those
        # beside the tree tell by their loops how far the poses can be trusted.
        for a, b in itertools.combinations(range(len(grids)), 2):
            options = {
                "gravity_aligned": gravity_aligned,
                "allow_changes": allow_changes,
                "init_guess": init_guess,
                "config": settings,
                "on_stage": partial(_announce_of, stages, f"maps {a} and {b}"),
            }
            features_a, features_b = features[a], features[b]
            # Maps without an occupied voxel, and those in another unit, go the same way as those of the paper:
            # `register` has a sentence for them.
            if features_a is None or features_b is None or voxel is None:
                found = register(grids[a], grids[b], preset=preset, **options)
            else:
                found = register_features(features_a, features_b, **options)
                again = partial(
                    register, config=settings, gravity_aligned=gravity_aligned, allow_changes=allow_changes
                )
                found = voxel.noted(in_feet(grids[a], grids[b], found, again))
            pairs.append((a, b, found))

    # 3. Poses along the best tree of accepted pairs.
    # A tree closes no loop: what the accepted pairs beside it say is reported as `loops`.
    tree = spanning_tree(len(grids), pairs)
    poses = chain_poses(len(grids), tree)
    chosen = [number for number, pose in enumerate(poses) if pose is not None]

    # 4. One map of all that have a pose.
    grid = None
    with stages.measure("fuse"):
        if chosen:
            stages.announce("fuse")
            # The maps as they were given are fused, not those at the working voxel size: no detail is lost for
            # the registration.
            options = {"rule": rule, "out": out, "num_processes": num_processes}
            grid = fuse([grids[n] for n in chosen], [poses[n] for n in chosen], **options)
    status: Status = "no_overlap" if not chosen else "merged" if len(chosen) == len(grids) else "partial"
    return Merge(
        grid=grid,
        poses=tuple(poses),
        pairs=tuple(pairs),
        status=status,
        loops=tuple(loop_errors(grids, poses, pairs, tree)),
        seconds=stages.seconds | {"total": time.perf_counter() - start},
        late=tuple(None if f is None else f.searched.late for f in features),
        middles=tuple(
            _middle(g, None if f is None else f.origin) for g, f in zip(grids, features, strict=True)
        ),
    )


def _check(grids: Sequence[VoxelGrid], init_guess: object) -> None:
    """Raise if there are fewer than two maps, or a guess for more than one pair."""
    if len(grids) < 2:
        raise InputError(f"merge needs at least two maps, got {len(grids)}.")
    if init_guess is not None and len(grids) != 2:
        raise InputError(
            f"init_guess is the pose of one pair, so it needs exactly two maps, got {len(grids)}."
        )


def _features_of_all(
    grids: Sequence[VoxelGrid], settings: Config, stages: Stages
) -> tuple[list[Any], WorkingVoxel | None]:
    """`MapFeatures` of each map and their voxel size; None for empty maps and those in another unit, and if all are."""
    # Neither an empty map nor one in another unit must decide the voxel size at which the others are compared.
    odd = in_odd_units(grids)
    filled = [number for number, grid in enumerate(grids) if grid.num_occupied and number not in odd]
    features: list[MapFeatures | None] = [None] * len(grids)
    if not filled:
        return features, None
    voxel = working_voxel([grids[n] for n in filled], settings)
    # All features are kept at the same time here, so the estimate is for all maps together.
    check_register_memory([grids[n] for n in filled], voxel.size)
    stages.announce(f"features of {len(filled)} maps")
    found = spread(
        partial(features_at, voxel_size=voxel.size, config=settings),
        [grids[n] for n in filled],
    )
    for number, one in zip(filled, found, strict=True):
        features[number] = one
    return features, voxel


def _middle(grid: VoxelGrid, origin: np.ndarray | None) -> np.ndarray:
    """Middle of a map in its own frame [m]: the zero of the local frame of its features, which strays do not move."""
    return np.mean(grid.extent, axis=0) if origin is None else np.asarray(origin, np.float64)


def _announce_of(stages: Stages, pair: str, name: str) -> None:
    """Announce a stage of a pair."""
    stages.announce(f"{pair}: {name}")
