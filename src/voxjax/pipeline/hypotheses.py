"""Which sources a round of hypotheses asks: settings become arguments of the sources here."""

import numpy as np

from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.proposals import (
    PoseRange,
    Proposals,
    admit,
    propose_corner_frames,
    propose_exhaustively,
    propose_from_descriptors,
    propose_guess,
    propose_subgraphs,
)
from .config import SourceConfig
from .stages import Stages


def first_hypotheses(
    a: MapFeatures,
    b: MapFeatures,
    source: SourceConfig,
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
        source: Which sources are asked, and how many poses each may give.
        guess: One more pose (4, 4) to try.
        pose_range: Which poses can be.
        stages: Keeps the seconds of each source.
    """
    stages.announce("hypotheses")
    found = [] if guess is None else [propose_guess(guess)]
    if source.exhaustive:
        with stages.measure("exhaustive search"):
            found.append(
                propose_exhaustively(
                    a,
                    b,
                    gravity_aligned=pose_range.gravity_aligned,
                    max_rotations=source.max_rotations,
                    num_peaks=source.num_peaks,
                )
            )
    return admit(found, pose_range)


def other_hypotheses(
    a: MapFeatures, b: MapFeatures, source: SourceConfig, *, pose_range: PoseRange, stages: Stages
) -> Proposals:
    """Corner frames, common subgraphs of the corners and cliques of descriptors.

    Args:
        a: First map.
        b: Second map.
        source: Which sources are asked, and how many poses each may give.
        pose_range: Which poses can be.
        stages: Keeps the seconds of each source.
    """
    stages.announce("hypotheses")
    found = []
    if source.corners:
        with stages.measure("corner frames"):
            found.append(propose_corner_frames(a, b, pose_range))
    if source.subgraph:
        with stages.measure("common subgraph"):
            found.append(
                propose_subgraphs(
                    a, b, distance_tolerance=source.distance_tolerance, max_corners=source.max_corners
                )
            )
    if source.descriptors:
        with stages.measure("descriptors"):
            found.append(propose_from_descriptors(a, b, max_poses=source.max_descriptor_poses))
    return admit(found, pose_range)
