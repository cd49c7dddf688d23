"""The coarse search as a source of hypotheses: its settings become arguments here.

The finest cells that are affordable find poses of which the coarse score is high; where surfaces are rough or maps
sparse, the right one is not among them. On cells of up to six voxels it is, and its place, no better than a cell, is
aligned before anything ranks it.
"""

from collections.abc import Sequence

import numpy as np

from ..registration.causes.coarse_search import coarse_starts
from ..registration.causes.similarity import Start
from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.pose_range import PoseRange
from ..registration.hypotheses.proposals import Proposals, admit
from ..registration.judging.leaders import refine_poses
from .config import Config


def coarse_starts_of(
    a: MapFeatures,
    b: MapFeatures,
    scales: Sequence[float],
    num_starts: int,
    settings: Config,
    *,
    max_lean: float | None = None,
) -> list[Start]:
    """`coarse_starts` with the settings of all stages.

    Args:
        a: First map.
        b: Second map.
        scales: What its lengths are multiplied by.
        num_starts: How many starts are kept, of all scales together.
        settings: Settings of the stages.
        max_lean: Largest angle by which a rotation may tilt the vertical [deg]; None where it may tilt it at will.
    """
    return coarse_starts(
        a,
        b,
        scales,
        num_starts=num_starts,
        max_lean=max_lean,
        settings=settings.cause,
        source=settings.source,
        rotation=settings.rotation,
        evidence=settings.evidence,
    )


def coarse_proposals(
    a: MapFeatures,
    b: MapFeatures,
    settings: Config,
    *,
    pose_range: PoseRange,
    guess: np.ndarray | None = None,
) -> Proposals:
    """Distinct poses of the coarse search, aligned, and a guess before them.

    Args:
        a: First map.
        b: Second map.
        settings: Settings of the stages.
        pose_range: The poses that can be.
        guess: One more pose (4, 4), or None.
    """
    leader, count = settings.leader, settings.cause.num_leaders
    starts = coarse_starts_of(a, b, (1.0,), count, settings, max_lean=pose_range.max_lean)
    poses = [*([] if guess is None else [guess]), *(start.T_a_b for start in starts)]
    if not poses:
        return Proposals(np.zeros((0, 4, 4), np.float32), (), 0, {})
    aligned = refine_poses(
        a.prepared,
        b.prepared,
        np.stack(poses),
        num_points=leader.num_rough_points,
        num_steps=leader.num_rough_steps,
        start_distance=leader.rough_start_distance,
        final_distance=leader.rough_final_distance,
    )
    return admit([Proposals(aligned, ("exhaustive",) * len(aligned), len(aligned), {})], pose_range)
