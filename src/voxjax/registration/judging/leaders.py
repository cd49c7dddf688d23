"""From many hypotheses to a few distinct, refined leaders, judged by all voxels of both maps."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._runtime.placement import to_device
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.align import align_poses
from ..hypotheses.distinct import distinct_poses
from ..hypotheses.proposals import Proposals
from ..hypotheses.ranking import rank_poses
from ..hypotheses.settings import EvidenceConfig
from .judgement import Judgement, judge_poses, no_judgement
from .settings import LeaderConfig


def refine_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int,
    num_steps: int,
    start_distance: float,
    final_distance: float,
) -> Float[np.ndarray, "k 4 4"]:
    """Align each pose, b onto the surface of a; distances are robust scales [voxel]."""
    rows = sample_rows(b, num_points)
    # Points are drawn by leverage, and therefore all count the same.
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    points = np.asarray(b.points)[rows]
    start, final = to_device((np.float32(start_distance), np.float32(final_distance)))
    refined = align_poses(
        a.keys,
        a.block,
        a.points,
        a.normals,
        points,
        weights,
        poses.astype(np.float32),
        num_steps=num_steps,
        start_distance=start,
        final_distance=final,
    )
    return np.asarray(refined)


class Tried(NamedTuple):
    """Poses that were refined once, the best of all hypotheses: what chance and repetition give in these two maps.

    Attributes:
        poses: float32 (m, 4, 4) `T_a_b`.
        strengths: (m,) strength of each by some voxels (`Judgement.strength`).
    """

    poses: np.ndarray
    strengths: np.ndarray


class Leaders(NamedTuple):
    """Distinct refined poses, best first.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`.
        judgement: Evidence over all voxels.
        sources: Name of the source of each pose.
        tried: Poses that the leaders were chosen from.
    """

    poses: np.ndarray
    judgement: Judgement
    sources: tuple[str, ...]
    tried: Tried

    def take(self, rows: np.ndarray) -> "Leaders":
        """Some of the leaders, in the order given."""
        sources = tuple(self.sources[row] for row in rows)
        return Leaders(self.poses[rows], self.judgement.take(rows), sources, self.tried)


def find_leaders(
    a: PreparedMap, b: PreparedMap, proposals: Proposals, settings: LeaderConfig, weights: EvidenceConfig
) -> Leaders:
    """Rank proposals, refine the better ones, and rank again; no leader where nothing was proposed.

    Unrefined poses are judged at a coarse tolerance, because ranking them as if they were final loses right ones.

    Args:
        a: First map.
        b: Second map.
        proposals: Hypotheses, however many.
        settings: How many of them survive each stage, and by how many points they are compared.
        weights: How much conflicts weigh before and after refinement.
    """
    poses, sources = proposals.poses, proposals.sources
    if len(poses) == 0:
        # An empty set of leaders goes through all later stages, so that the verdict has the sentence for it.
        has_free_space = a.has_free_space and b.has_free_space
        nothing = no_judgement(weights.conflict_weight, has_free_space=has_free_space)
        return Leaders(poses, nothing, (), Tried(poses, np.zeros(0)))
    coarse, weight = weights.coarse_conflict_weight, weights.conflict_weight

    # 1. All hypotheses by few points; of those that are alike the best.
    scores = rank_poses(a, b, poses, num_points=settings.num_quick_points, conflict_weight=coarse)
    rows = _best_unrefined(a, b, poses, scores, settings, settings.num_ranked)

    # 2. The better ones by more points, and with the sides of their surfaces.
    judged = judge_poses(
        a, b, poses[rows], num_points=settings.num_coarse_points, conflict_weight=coarse, is_coarse=True
    )
    # The rows lead back to the proposals, so that each leader keeps the name of its source.
    rows = rows[_best_unrefined(a, b, poses[rows], judged.score(), settings, settings.num_refined)]

    # 3. Refined from afar, and judged at the tolerance of refined poses.
    refined = refine_poses(
        a,
        b,
        poses[rows],
        num_points=settings.num_rough_points,
        num_steps=settings.num_rough_steps,
        start_distance=settings.rough_start_distance,
        final_distance=settings.rough_final_distance,
    )
    judged = judge_poses(a, b, refined, num_points=settings.num_rough_judges, conflict_weight=weight)
    tried = Tried(refined, judged.strength())
    kept = _best_refined(a, b, refined, judged.strength(), settings)
    rows, refined = rows[kept], refined[kept]

    # 4. Refined more closely, and judged by all voxels.
    refined = refine_poses(
        a,
        b,
        refined,
        num_points=settings.num_fine_points,
        num_steps=settings.num_fine_steps,
        start_distance=settings.fine_start_distance,
        final_distance=settings.fine_final_distance,
    )
    judged = judge_poses(a, b, refined, num_points=None, conflict_weight=weight)
    leaders = Leaders(refined, judged, tuple(sources[row] for row in rows), tried)
    return leaders.take(_best_refined(a, b, refined, judged.strength(), settings))


def merge_leaders(
    a: PreparedMap, b: PreparedMap, first: Leaders, second: Leaders, settings: LeaderConfig
) -> Leaders:
    """The best distinct poses of two sets of leaders."""
    both = Leaders(
        np.concatenate([first.poses, second.poses]),
        first.judgement.joined(second.judgement),
        (*first.sources, *second.sources),
        Tried._make(map(np.concatenate, zip(first.tried, second.tried, strict=True))),
    )
    return both.take(_best_refined(a, b, both.poses, both.judgement.strength(), settings))


def _best_unrefined(
    a: PreparedMap,
    b: PreparedMap,
    poses: np.ndarray,
    scores: np.ndarray,
    settings: LeaderConfig,
    max_count: int,
) -> np.ndarray:
    """Rows of the best poses that differ by more than unrefined ones of one place do."""
    return distinct_poses(
        poses,
        np.asarray(b.centroid, np.float64),
        scores=scores,
        metres=settings.unrefined_voxels * a.grid.voxel_size,
        degrees=settings.unrefined_degrees,
        max_count=max_count,
    )


def _best_refined(
    a: PreparedMap, b: PreparedMap, poses: np.ndarray, scores: np.ndarray, settings: LeaderConfig
) -> np.ndarray:
    """Rows of the best poses that differ by more than refined ones of one place do."""
    return distinct_poses(
        poses,
        np.asarray(b.centroid, np.float64),
        scores=scores,
        metres=settings.distinct_voxels * a.grid.voxel_size,
        degrees=settings.distinct_degrees,
        max_count=settings.num_leaders,
    )
