"""Register two maps: features, hypotheses from all sources, leaders, evidence, verdict, refinement."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np

from .._checks import InputError, check_choice, check_pose, check_positive
from .._results import RESULTS
from .._runtime.mappings import release_kernels_if_crowded
from .._runtime.threads import spread
from ..grid import VoxelGrid
from ..refinement.refine import refine
from ..registration.hypotheses.map_features import FREE_SPACE, MapFeatures, map_features
from ..registration.judging.conflict_pieces import evidence
from ..registration.judging.leaders import Leaders
from ..registration.judging.verdict import Finding, decide, probabilities
from ..registration.paper.register import register_paper
from ..registration.types import Hypothesis, Registration
from .config import Config, config_from
from .memory_need import check_register_memory
from .outcome import evidence_of, nothing_found, with_stats
from .search import search

FINE_VOXEL = 0.075
"""Maps finer than this [m] are brought to about 0.1 m: the trials behind the evidence ran there."""

MAX_NONE = 0.1
"""Other sources are asked only if no leader is right with at least this probability."""

LAST_REACH = 2.0
"""Robust scale at which the last refinement starts [voxel]."""

LAST_POINTS = 4096
"""Voxels of each map in the last refinement."""


def register(
    a: VoxelGrid,
    b: VoxelGrid,
    *,
    preset: Literal["default", "paper"] = "default",
    config: Config | Mapping[str, Any] | None = None,
    gravity_aligned: bool = False,
    init_guess: object = None,
    guess_uncertainty: tuple[float, float] | None = None,
    on_stage: Callable[[str], None] | None = None,
) -> Registration:
    """Find how map b lies in map a, or say that the maps do not show it.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved; the voxel sizes may differ.
        preset: "default", or "paper" for the published method alone.
        config: Settings of the stages of the default preset: a `Config`, nested tables, or None for the defaults.
        gravity_aligned: The z axes of both maps point up, so that only yaw is unknown; default preset only.
        init_guess: A (4, 4) `T_a_b` that is tried as one more hypothesis; default preset only.
        guess_uncertainty: With a guess: poses that put map b's centroid farther from where the guess puts it than the
            first number [m], or turn it by more than the second [rad], are left out.
        on_stage: Called with the name of each stage as it starts.

    Returns:
        The pose with verdict, confidence, covariance and all other hypotheses. Maps without overlap, without
        corners or without voxels are an outcome, not an error.

    Raises:
        InputError: If a setting or the guess cannot be used, or the maps need more memory than there is
            (`pipeline/memory_need.py`).
    """
    check_choice("preset", preset, ("default", "paper"))
    if preset == "paper" and (gravity_aligned or init_guess is not None or guess_uncertainty is not None):
        raise InputError(
            "preset 'paper' takes neither gravity_aligned nor init_guess nor guess_uncertainty, which the published "
            "method does not know; leave them out or take the preset 'default'."
        )
    settings = config_from(config)
    announce = on_stage if on_stage is not None else _silent
    for name, grid in (("a", a), ("b", b)):
        if grid.num_occupied == 0:
            return nothing_found(f"Map {name} has no occupied voxel.", RESULTS.empty_map)
    if preset == "paper":
        announce("the paper's pipeline")
        return register_paper(a, b)
    size = working_voxel_size([a, b], settings)
    check_register_memory([a, b], size)
    seconds = {}
    start = time.perf_counter()
    announce("features")

    def features_of(grid: VoxelGrid) -> MapFeatures:
        return prepare(grid, voxel_size=size, infer_free_space=settings.map.infer_free_space)

    features_a, features_b = spread(features_of, (a, b))
    seconds["features"] = time.perf_counter() - start
    return register_prepared(
        features_a, features_b, config=settings, gravity_aligned=gravity_aligned, init_guess=init_guess,
        guess_uncertainty=guess_uncertainty,
        on_stage=on_stage, seconds=seconds,
    )  # fmt: skip


def working_voxel_size(grids: list[VoxelGrid], settings: Config) -> float:
    """Voxel size [m] at which maps are compared: the coarsest map's, after fine ones are brought to about 0.1 m."""
    if settings.map.voxel_size > 0:
        return settings.map.voxel_size
    sizes = [
        g.voxel_size * (max(round(0.1 / g.voxel_size), 1) if g.voxel_size < FINE_VOXEL else 1) for g in grids
    ]
    return max(sizes)


def prepare(
    grid: VoxelGrid, *, voxel_size: float, max_virtual: int = 256, infer_free_space: bool = True
) -> MapFeatures:
    """Features of one map for all its pairs.

    Args:
        grid: With at least one occupied voxel.
        voxel_size: Working voxel size [m] of all maps that it is compared with.
        max_virtual: Largest number of virtual corners.
        infer_free_space: Take what surfaces enclose for free where the map records no free space.

    Raises:
        InputError: If nothing is occupied.
    """
    if grid.num_occupied == 0:
        raise InputError("grid must have at least one occupied voxel, got none; leave the map out.")
    release_kernels_if_crowded()
    same = abs(grid.voxel_size - voxel_size) < 1e-6 * voxel_size
    return map_features(
        grid if same else grid.with_voxel_size(voxel_size),
        max_virtual=max_virtual,
        infer_free_space=infer_free_space,
    )


def register_prepared(
    a: MapFeatures,
    b: MapFeatures,
    *,
    config: Config | Mapping[str, Any] | None = None,
    gravity_aligned: bool = False,
    init_guess: object = None,
    guess_uncertainty: tuple[float, float] | None = None,
    on_stage: Callable[[str], None] | None = None,
    seconds: dict[str, float] | None = None,
) -> Registration:
    """`register` for maps whose features are known (`prepare`), both at the same voxel size.

    Raises:
        InputError: If the voxel sizes differ, or a setting or the guess cannot be used.
    """
    settings = config_from(config)
    announce = on_stage if on_stage is not None else _silent
    if abs(a.prepared.grid.voxel_size - b.prepared.grid.voxel_size) > 1e-6 * a.prepared.grid.voxel_size:
        raise InputError(
            "a and b must be prepared at the same voxel_size, got "
            f"{a.prepared.grid.voxel_size:g} and {b.prepared.grid.voxel_size:g}; prepare both at the coarser one."
        )
    if guess_uncertainty is not None:
        if init_guess is None:
            raise InputError("guess_uncertainty needs an init_guess that it is about; give both or neither.")
        for name, value in zip(("metres", "radians"), guess_uncertainty, strict=True):
            check_positive(f"guess_uncertainty ({name})", value, name)
    seconds = dict(seconds or {})
    release_kernels_if_crowded()

    has_free_space = a.prepared.has_free_space and b.prepared.has_free_space
    free_space = min(a.free_space, b.free_space, key=FREE_SPACE.index)

    def verdict_of(leaders: Leaders) -> Finding:
        return decide(
            leaders.judgement,
            has_free_space=has_free_space,
            is_inferred=free_space == "inferred",
            **dataclasses.asdict(settings.verdict),
        )

    def is_decided(leaders: Leaders) -> bool:
        none = probabilities(leaders.judgement, has_free_space=has_free_space)[0]
        # Where one of the leaders is right, more sources do not tell which.
        return verdict_of(leaders).verdict == "accepted" or bool(none < MAX_NONE)

    # 1. Distinct leaders from the hypotheses of the sources, refined, judged by all voxels.
    found = search(
        a, b, settings, gravity_aligned=gravity_aligned,
        guess=None if init_guess is None else check_pose("init_guess", init_guess), uncertainty=guess_uncertainty,
        is_decided=is_decided, announce=announce,
    )  # fmt: skip
    seconds.update(found.seconds)
    leaders = found.leaders
    if leaders is None:
        nothing = nothing_found(
            "No source proposed a pose: the maps have too little structure.", RESULTS.too_few_corners
        )
        return with_stats(nothing, found.stats, seconds)

    # 2. The pose, its covariance and the verdict.
    announce("verdict")
    start = time.perf_counter()
    finding = verdict_of(leaders)
    refined = refine(
        a.prepared, b.prepared, leaders.poses[0], max_distance=LAST_REACH * a.prepared.grid.voxel_size,
        num_points=LAST_POINTS, both_ways=True,
    )  # fmt: skip
    T_a_b, covariance = np.asarray(refined.T_a_b), np.asarray(refined.covariance)
    seconds["verdict"] = time.perf_counter() - start

    scores = evidence(leaders.judgement)
    hypotheses = tuple(
        Hypothesis(
            leaders.poses[i] if i else T_a_b,
            float(scores[i]),
            found.sources[i],
            evidence_of(leaders.judgement, i, a.prepared.num_points + b.prepared.num_points),
        )
        for i in range(len(scores))
    )
    result = {
        "accepted": RESULTS.successful,
        "ambiguous": RESULTS.ambiguous,
        "no_overlap": RESULTS.no_overlap,
    }
    return with_stats(
        Registration(
            T_a_b=T_a_b, verdict=finding.verdict, confidence=finding.confidence, covariance=covariance,
            hypotheses=hypotheses, reason=finding.reason, result=result[finding.verdict], stats={},
        ),
        found.stats | {"source": hypotheses[0].source, "has_free_space": has_free_space, "free_space": free_space},
        seconds,
    )  # fmt: skip


def _silent(stage: str) -> None:
    """Announce nothing."""
