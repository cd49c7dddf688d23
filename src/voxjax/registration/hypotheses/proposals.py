"""Hypotheses of a pair, source by source: each source is one function that gives `Proposals`.

`admit` joins what several sources proposed and leaves out the poses that cannot be (`pose_range`).

To add a source of hypotheses: write a `propose_` function here, give it a switch in `SourceConfig` (`settings.py`; a
table of settings of its own is a field of `Config` too), ask it in a round of `pipeline/hypotheses.py`, and add the
name that it gives its poses to the list of `Hypothesis.source` (`registration/types.py`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..._runtime.threads import spread
from ...matching.descriptors import MapDescriptors
from .corners import frame_poses, subgraph_poses
from .descriptors import descriptor_hypotheses
from .distinct import distinct_poses
from .exhaustive import exhaustive_hypotheses, upright_frame
from .map_features import MapFeatures
from .pair_rotations import rotations_of_pair
from .pose_range import PoseRange
from .ranking import rank_poses
from .settings import (
    DescriptorConfig,
    ExhaustiveConfig,
    FrameConfig,
    RotationConfig,
    SourceConfig,
    SubgraphConfig,
)


class Proposals(NamedTuple):
    """Candidate poses and where each comes from.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`.
        sources: Name of the source of each pose.
        num_found: How many poses the sources found, before any were left out.
        counts: What the sources counted on the way, for the report.
    """

    poses: Float[np.ndarray, "k 4 4"]
    sources: tuple[str, ...]
    num_found: int
    counts: dict[str, Any]


def admit(proposals: Sequence[Proposals], pose_range: PoseRange) -> Proposals:
    """All poses of several sources that can be, in the order given."""
    poses = np.concatenate(
        [np.zeros((0, 4, 4), np.float32), *(p.poses.astype(np.float32) for p in proposals)]
    )
    sources = [name for p in proposals for name in p.sources]
    # The order stays: of poses that score alike the ranking takes the first, and with it the name of its source.
    rows = np.flatnonzero(
        np.concatenate([np.zeros(0, bool), *(pose_range.admits(p.poses) for p in proposals)])
    )
    counts: dict[str, Any] = {}
    for p in proposals:
        counts |= p.counts
    return Proposals(
        poses[rows], tuple(sources[row] for row in rows), sum(p.num_found for p in proposals), counts
    )


def propose_guess(T_a_b: Float[np.ndarray, "4 4"]) -> Proposals:
    """A pose from outside; it is no finding, so it is not counted."""
    return Proposals(T_a_b[None], ("guess",), 0, {})


def propose_exhaustively(
    a: MapFeatures,
    b: MapFeatures,
    source: SourceConfig,
    *,
    max_lean: float | None,
    conflict_weight: float,
    rotation: RotationConfig,
    exhaustive: ExhaustiveConfig,
) -> Proposals:
    """The best translations of all rotations that the normals of both maps allow.

    Args:
        a: First map.
        b: Second map.
        source: How many rotations, and how many translations of each.
        max_lean: Largest angle by which a rotation may tilt the vertical [deg]; None where it may tilt it at will.
        conflict_weight: How many hits a conflict outweighs.
        rotation: How rotations are found.
        exhaustive: How fine the translations are searched.
    """
    rotations = rotations_of_pair(
        a, b, max_lean=max_lean, max_rotations=source.max_rotations, settings=rotation
    )
    poses, _ = exhaustive_hypotheses(
        a.prepared,
        b.prepared,
        rotations,
        # The frame of a alone serves both maps: b is brought into it by each of the rotations.
        upright_frame(a.directions, a.shares),
        conflict_weight=conflict_weight,
        num_peaks=source.num_peaks,
        settings=exhaustive,
    )
    return Proposals(poses, ("exhaustive",) * len(poses), len(poses), {"num_rotations": len(rotations)})


def propose_corner_frames(
    a: MapFeatures, b: MapFeatures, frame: FrameConfig, *, pose_range: PoseRange, conflict_weight: float
) -> Proposals:
    """The best poses of single corner pairs, among those that can be.

    Args:
        a: First map.
        b: Second map.
        frame: Which pairs make a pose, and how many poses are kept.
        pose_range: Which poses can be.
        conflict_weight: How many hits a conflict outweighs.
    """
    # Corners are computed here, when first asked for, those of both maps side by side.
    corners_a, corners_b = spread(lambda features: features.corners, (a, b))
    counts = {"num_corners_a": corners_a.num_listed, "num_corners_b": corners_b.num_listed}
    found = frame_poses(
        corners_a, corners_b, angle_tolerance=frame.angle_tolerance, max_poses=frame.max_pairs
    )
    # This comes before the ranking, in which poses that cannot be would take the places of those that can.
    is_admitted = pose_range.admits(found.poses)
    poses, is_observed = found.poses[is_admitted], found.is_observed[is_admitted]
    if len(poses) == 0:
        return Proposals(poses, (), 0, counts)
    scores = rank_poses(
        a.prepared, b.prepared, poses, num_points=frame.num_points, conflict_weight=conflict_weight
    )
    # Telling poses apart takes time by the square of their number, so that only the better ones come to it.
    kept = np.argsort(-scores, kind="stable")[: 16 * frame.max_poses]
    chosen = kept[
        distinct_poses(
            poses[kept],
            np.asarray(b.prepared.centroid, np.float64),
            scores=scores[kept],
            metres=frame.distinct_voxels * a.prepared.grid.voxel_size,
            degrees=frame.distinct_degrees,
            max_count=frame.max_poses,
        )
    ]
    names = tuple("corner" if is_observed[row] else "virtual corner" for row in chosen)
    return Proposals(poses[chosen], names, len(poses), counts)


def propose_subgraphs(
    a: MapFeatures, b: MapFeatures, source: SourceConfig, subgraph: SubgraphConfig
) -> Proposals:
    """The poses of the maximum common subgraphs of the corners.

    Args:
        a: First map.
        b: Second map.
        source: Tolerance of the distances, and corners that take part.
        subgraph: How the subgraph is searched.
    """
    found = subgraph_poses(
        a.corners,
        b.corners,
        distance_tolerance=source.distance_tolerance * a.prepared.grid.voxel_size,
        max_corners=source.max_corners,
        settings=subgraph,
    )
    counts = {
        "num_associations": found.num_associations,
        "clique_size": found.clique_size,
        "subgraph_completed": found.completed,
    }
    return Proposals(found.poses, ("subgraph",) * len(found.poses), len(found.poses), counts)


def propose_from_descriptors(
    a: MapFeatures, b: MapFeatures, descriptor: DescriptorConfig, *, max_poses: int
) -> Proposals:
    """The poses of the largest cliques of matched local descriptors.

    Args:
        a: First map.
        b: Second map.
        descriptor: How descriptors are matched and cliques grown.
        max_poses: Largest number of poses.
    """
    # Descriptors of normals that are signed by different rules cannot be compared.
    use_free_space = a.prepared.has_free_space and b.prepared.has_free_space
    finest = max(spread(lambda features: features.late.finest_level, (a, b)))

    def described(features: MapFeatures) -> MapDescriptors:
        return features.late.descriptors(use_free_space=use_free_space, finest=finest)

    described_a, described_b = spread(described, (a, b))
    poses, sizes = descriptor_hypotheses(
        described_a, described_b, max_hypotheses=max_poses, settings=descriptor
    )
    counts = {"descriptor_clique_size": int(sizes[0]) if len(sizes) else 0}
    return Proposals(poses, ("descriptor",) * len(poses), len(poses), counts)
