"""Which sources a round of hypotheses asks: settings become arguments of the sources here."""

import numpy as np

from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.pose_range import PoseRange
from ..registration.hypotheses.proposals import (
    Proposals,
    admit,
    propose_corner_frames,
    propose_exhaustively,
    propose_from_descriptors,
    propose_guess,
    propose_subgraphs,
)
from .config import Config
from .stage_times import Stages


def first_hypotheses(
    a: MapFeatures,
    b: MapFeatures,
    settings: Config,
    *,
    guess: np.ndarray | None,
    pose_range: PoseRange,
    stages: Stages,
) -> Proposals:
    """A guess, if there is one, and the best translations of all rotations: what needs no corners.

    Corners and descriptors take longer than everything else together, and where the exhaustive search is enough they
    add nothing: they would be judged by the same evidence.

    Args:
        a: First map.
        b: Second map.
        settings: Sources that are asked, and how each of them works.
        guess: One more pose (4, 4) to try.
        pose_range: The poses that can be.
        stages: Keeps the seconds of each source.
    """
    stages.announce("hypotheses")
    # The guess comes first and is judged as all others are: a wrong one does no more harm than any hypothesis.
    found = [] if guess is None else [propose_guess(guess)]
    if settings.source.exhaustive:
        with stages.measure("exhaustive search"):
            found.append(
                propose_exhaustively(
                    a,
                    b,
                    settings.source,
                    max_lean=pose_range.max_lean,
                    conflict_weight=settings.evidence.coarse_conflict_weight,
                    rotation=settings.rotation,
                    exhaustive=settings.exhaustive,
                )
            )
    # What the caller knows beforehand holds for all sources alike, also for those that cannot be told of it.
    return admit(found, pose_range)


def other_hypotheses(
    a: MapFeatures, b: MapFeatures, settings: Config, *, pose_range: PoseRange, stages: Stages
) -> Proposals:
    """Corner frames, common subgraphs of the corners and cliques of descriptors.

    Args:
        a: First map.
        b: Second map.
        settings: Sources that are asked, and how each of them works.
        pose_range: The poses that can be.
        stages: Keeps the seconds of each source.
    """
    stages.announce("hypotheses")
    found, source = [], settings.source
    if source.corners:
        with stages.measure("corner frames"):
            found.append(
                propose_corner_frames(
                    a,
                    b,
                    settings.frame,
                    pose_range=pose_range,
                    conflict_weight=settings.evidence.coarse_conflict_weight,
                )
            )
    if source.subgraph:
        with stages.measure("common subgraph"):
            found.append(propose_subgraphs(a, b, source, settings.subgraph))
    if source.descriptors:
        with stages.measure("descriptors"):
            found.append(
                propose_from_descriptors(a, b, settings.descriptor, max_poses=source.max_descriptor_poses)
            )
    return admit(found, pose_range)
