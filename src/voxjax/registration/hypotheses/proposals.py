"""Hypotheses of a pair, source by source: each source is one function that gives `Proposals`.

`admit` joins what several sources proposed and leaves out the poses that cannot be (`PoseRange`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._runtime.threads import spread
from .corners import frame_poses, subgraph_poses
from .descriptors import descriptor_hypotheses
from .exhaustive import exhaustive_hypotheses, upright_frame
from .map_features import MapFeatures
from .ranking import distinct_poses, rank_poses
from .rotations import rotation_hypotheses

MAX_FRAME_POSES = 256
"""Corner frames that go on to the common ranking, after their own."""

UPRIGHT_COSINE = np.cos(np.radians(8.0))
"""Maps that are gravity aligned may still lean by so much against each other."""


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


class PoseRange(NamedTuple):
    """Which poses of a pair can be.

    Attributes:
        centroid: Centroid of map b [m], float32 (3,).
        gravity_aligned: Whether only poses that keep the vertical count.
        guess: A pose (4, 4) that the others must be near to; None where any pose may be.
        metres: Largest distance between where a pose and the guess put the centroid [m].
        radians: Largest angle between a pose and the guess [rad].
    """

    centroid: Float[np.ndarray, "3"]
    gravity_aligned: bool = False
    guess: Float[np.ndarray, "4 4"] | None = None
    metres: float = np.inf
    radians: float = np.inf

    def admits(self, poses: Float[np.ndarray, "k 4 4"]) -> Bool[np.ndarray, "k"]:
        """Whether each pose is upright, where it must be, and near the guess."""
        is_admitted = np.ones(len(poses), bool)
        if self.gravity_aligned:
            is_admitted &= poses[:, 2, 2] > UPRIGHT_COSINE
        if self.guess is not None:
            change = poses - self.guess[None]
            offset = change[:, :3, :3] @ self.centroid + change[:, :3, 3]
            trace = np.einsum("kij,ij->k", poses[:, :3, :3], self.guess[:3, :3])
            is_admitted &= np.linalg.norm(offset, axis=1) <= self.metres
            is_admitted &= trace >= 1.0 + 2.0 * np.cos(min(self.radians, np.pi))
        return is_admitted


def admit(proposals: Sequence[Proposals], pose_range: PoseRange) -> Proposals:
    """All poses of several sources that can be, in the order given."""
    poses = np.concatenate(
        [np.zeros((0, 4, 4), np.float32), *(p.poses.astype(np.float32) for p in proposals)]
    )
    sources = [name for p in proposals for name in p.sources]
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
    a: MapFeatures, b: MapFeatures, *, gravity_aligned: bool, max_rotations: int, num_peaks: int
) -> Proposals:
    """The best translations of all rotations that the normals of both maps allow.

    Args:
        a: First map.
        b: Second map.
        gravity_aligned: Whether only rotations about the vertical count.
        max_rotations: Largest number of rotations.
        num_peaks: Translations kept for each rotation.
    """
    rotations, _ = rotation_hypotheses(
        a.normals,
        b.normals,
        a.directions,
        b.directions,
        max_rotations=max_rotations,
        is_signed=a.prepared.has_free_space and b.prepared.has_free_space,
        gravity_aligned=gravity_aligned,
    )
    frame = upright_frame(a.directions, a.shares)
    poses, _ = exhaustive_hypotheses(a.prepared, b.prepared, rotations, frame, num_peaks=num_peaks)
    return Proposals(poses, ("exhaustive",) * len(poses), len(poses), {"num_rotations": len(rotations)})


def propose_corner_frames(a: MapFeatures, b: MapFeatures, pose_range: PoseRange) -> Proposals:
    """The best poses of single corner pairs, among those that can be."""
    corners_a, corners_b = spread(lambda features: features.corners, (a, b))
    counts = {"num_corners_a": corners_a.num_listed, "num_corners_b": corners_b.num_listed}
    found = frame_poses(corners_a, corners_b)
    is_admitted = pose_range.admits(found.poses)
    poses, is_observed = found.poses[is_admitted], found.is_observed[is_admitted]
    if len(poses) == 0:
        return Proposals(poses, (), 0, counts)
    scores = rank_poses(a.prepared, b.prepared, poses, num_points=128)
    # Telling poses apart takes time by the square of their number, so that only the better ones come to it.
    kept = np.argsort(-scores, kind="stable")[: 16 * MAX_FRAME_POSES]
    chosen = kept[
        distinct_poses(
            poses[kept],
            scores[kept],
            np.asarray(b.prepared.centroid, np.float64),
            metres=2.0 * a.prepared.grid.voxel_size,
            degrees=1.5,
            max_count=MAX_FRAME_POSES,
        )
    ]
    names = tuple("corner" if is_observed[row] else "virtual corner" for row in chosen)
    return Proposals(poses[chosen], names, len(poses), counts)


def propose_subgraphs(
    a: MapFeatures, b: MapFeatures, *, distance_tolerance: float, max_corners: int
) -> Proposals:
    """The poses of the maximum common subgraphs of the corners.

    Args:
        a: First map.
        b: Second map.
        distance_tolerance: D of equation (4) [voxel].
        max_corners: Corners of each map that take part.
    """
    found = subgraph_poses(
        a.corners,
        b.corners,
        max_corners=max_corners,
        distance_tolerance=distance_tolerance * a.prepared.grid.voxel_size,
    )
    counts = {
        "num_associations": found.num_associations,
        "clique_size": found.clique_size,
        "subgraph_completed": found.completed,
    }
    return Proposals(found.poses, ("subgraph",) * len(found.poses), len(found.poses), counts)


def propose_from_descriptors(a: MapFeatures, b: MapFeatures, *, max_poses: int) -> Proposals:
    """The poses of the largest cliques of matched local descriptors, at most `max_poses`."""
    use_free_space = a.prepared.has_free_space and b.prepared.has_free_space
    described_a, described_b = spread(lambda f: f.late.descriptors(use_free_space=use_free_space), (a, b))
    poses, sizes = descriptor_hypotheses(described_a, described_b, max_hypotheses=max_poses)
    counts = {"descriptor_clique_size": int(sizes[0]) if len(sizes) else 0}
    return Proposals(poses, ("descriptor",) * len(poses), len(poses), counts)
