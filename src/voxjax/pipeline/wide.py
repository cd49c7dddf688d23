"""Maps of hundreds of metres: coarser copies, in which poses are looked for before they are judged in fine voxels."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from .._runtime.threads import spread
from ..maps.prepared import FIELD_RADIUS
from ..registration.hypotheses.exhaustive import affordable_coarsening, upright_frame, upright_sides
from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.pose_range import PoseRange
from ..registration.hypotheses.proposals import Proposals, admit, propose_guess
from ..registration.judging.leaders import Leaders, find_leaders
from ..registration.judging.verdict import Finding
from .config import Config
from .features import features_of
from .stage_times import Stages


def needed_coarsening(a: MapFeatures, b: MapFeatures, settings: Config) -> int:
    """How many times as wide voxels must be for the exhaustive search to be affordable; 1 for most maps.

    Args:
        a: First map.
        b: Second map.
        settings: How wide the cells of the search may be, and how many a block may have.
    """
    # A block of the search is as wide as both maps beside each other, which lie alike, for normals turn them.
    sides = sum(upright_sides(each.prepared, upright_frame(each.directions, each.shares)) for each in (a, b))
    return affordable_coarsening(np.asarray(sides) / a.prepared.grid.voxel_size, settings.exhaustive)


def finer_factors(factor: int) -> list[int]:
    """How many times as wide voxels are in each copy that poses pass on their way from the coarsest one, down to 1.

    Args:
        factor: That of the coarsest copy, above 1.
    """
    factors = []
    while factor > 1:
        # A refined pose is good to a voxel of its copy, and refinement in finer ones reaches so many voxels far.
        factor = -(-factor // FIELD_RADIUS)
        factors.append(factor)
    return factors


def coarser_features(features: MapFeatures, factor: int, settings: Config) -> MapFeatures:
    """Features of a map in voxels `factor` times as wide, in the same local frame; made once for all pairs of the map.

    Args:
        features: Features at the working voxel size.
        factor: A whole number; 1 gives the features themselves.
        settings: Settings of the stages.
    """
    if factor == 1:
        return features
    if factor not in features.coarser:
        grid = features.prepared.grid
        found = features_of(grid.with_voxel_size(factor * grid.voxel_size), features.origin, 0, settings)
        # Free space that was inferred in fine voxels is still inferred.
        features.coarser[factor] = dataclasses.replace(found, free_space=features.free_space)
    return features.coarser[factor]


def leaders_by_coarser_copies(
    a: MapFeatures,
    b: MapFeatures,
    factor: int,
    search: Callable[[MapFeatures, MapFeatures], tuple[Leaders, Finding, dict[str, Any]]],
    *,
    settings: Config,
    stages: Stages,
    pose_range: PoseRange,
    guess: np.ndarray | None,
) -> tuple[Leaders, dict[str, Any]]:
    """Leaders of a pair of wide maps, which were leaders in coarser voxels before, and what was counted on the way.

    Pieces of conflicts are not weighed yet.

    Args:
        a: First map.
        b: Second map.
        factor: How many times as wide voxels are in the copies that poses are looked for in, above 1.
        search: Finds leaders of two maps.
        settings: Settings of the stages.
        stages: Keeps the seconds of each stage.
        pose_range: The poses that can be.
        guess: One more pose (4, 4) to try, or None.
    """
    coarsest = _copies(a, b, factor, settings, stages)
    leaders, _, counts = search(*coarsest)
    counts["coarse_voxel_size"] = coarsest[0].prepared.grid.voxel_size
    options = {"settings": settings, "stages": stages, "pose_range": pose_range, "guess": guess}
    return leaders_through_copies(a, b, leaders, finer_factors(factor), **options), counts


def leaders_through_copies(
    a: MapFeatures,
    b: MapFeatures,
    proposed: Proposals | Leaders,
    factors: Sequence[int],
    *,
    settings: Config,
    stages: Stages,
    pose_range: PoseRange,
    guess: np.ndarray | None = None,
) -> Leaders:
    """Leaders of a pair that were leaders in each of some copies before.

    A rotation that is off by a fraction of a degree moves what lies hundreds of metres away by more than refinement in
    fine voxels reaches.

    Args:
        a: First map.
        b: Second map.
        proposed: Poses.
        factors: How many times as wide voxels are in each copy, falling; the last one is 1.
        settings: Settings of the stages.
        stages: Keeps the seconds of each stage.
        pose_range: The poses that can be.
        guess: One more pose (4, 4), which is tried in each copy anew, or None.
    """
    first = [] if guess is None else [propose_guess(guess)]
    for factor in factors:
        copy_a, copy_b = _copies(a, b, factor, settings, stages)
        passed = Proposals(proposed.poses, proposed.sources, len(proposed.poses), {})
        with stages.stage("leaders"):
            proposed = find_leaders(
                copy_a.prepared,
                copy_b.prepared,
                admit([*first, passed], pose_range),
                settings.leader,
                settings.evidence,
            )
    assert isinstance(proposed, Leaders)
    return proposed


def _copies(
    a: MapFeatures, b: MapFeatures, factor: int, settings: Config, stages: Stages
) -> list[MapFeatures]:
    """Both maps in voxels `factor` times as wide."""
    with stages.stage("coarser features"):
        return spread(partial(coarser_features, factor=factor, settings=settings), (a, b))
