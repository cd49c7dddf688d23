"""Whether map b has another scale than map a: the best pose with a seventh parameter, and how sure its scale is.

A wrong scale of a few percent shows at the best rigid pose, from which surfaces part toward the ends of the maps.
Beyond that no rigid pose stands out; then all translations are searched with some scales (`coarse_search`), on cells so
coarse that the scales between are found from there.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..._runtime.threads import spread
from ...maps.mirrored import scaled
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.scoring import score_poses
from ..hypotheses.map_features import MapFeatures
from ..judging.judgement import judge_poses
from ..judging.leaders import Leaders
from ..judging.settings import LeaderConfig
from ..judging.verdict import Finding
from .handedness import best_strength, conflict_share
from .settings import CauseConfig
from .similarity import Samples, Similarity, Start, align_similarity


def best_similarity(
    a: MapFeatures,
    b: MapFeatures,
    starts: Sequence[Start],
    *,
    settings: CauseConfig,
    leader: LeaderConfig,
    conflict_weight: float,
) -> tuple[Similarity, float] | None:
    """The similarity with the best evidence, and its score by some voxels; None where none is found.

    Args:
        a: First map.
        b: Second map.
        starts: Where alignments start.
        settings: How many of them are judged, and by how many points they are aligned.
        leader: Distances of the alignment, and by how many points poses are judged.
        conflict_weight: How many hits a conflict outweighs.
    """
    map_a, map_b = a.prepared, b.prepared
    start_distance = leader.rough_start_distance
    if len(starts) > settings.num_judged:
        # From afar by few points; what ends far outside of the scales that were searched is let go.
        found = _aligned(
            map_a,
            map_b,
            starts,
            settings.num_rough_points,
            start_distance,
            settings,
            leader,
            with_error=False,
        )
        found = [each for each in found if abs(np.log(each.scale)) <= 2.0 * settings.scale_step]
        scores = _quick_scores(map_a, map_b, found, leader.num_quick_points, conflict_weight)
        starts = [found[row].start for row in np.argsort(-scores, kind="stable")[: settings.num_judged]]
        start_distance = leader.fine_start_distance
    found = _aligned(map_a, map_b, starts, settings.num_points, start_distance, settings, leader)
    if not found:
        return None
    scores = [
        float(
            judge_poses(
                map_a,
                scaled(map_b, each.scale),
                each.T_a_b[None],
                num_points=leader.num_rough_judges,
                conflict_weight=conflict_weight,
            ).score()[0]
        )
        for each in found
    ]
    row = int(np.argmax(scores))
    return found[row], scores[row]


def _aligned(
    a: PreparedMap,
    b: PreparedMap,
    starts: Sequence[Start],
    num_points: int,
    start_distance: float,
    settings: CauseConfig,
    leader: LeaderConfig,
    *,
    with_error: bool = True,
) -> list[Similarity]:
    """Similarities that alignments from some starts lead to, side by side."""
    align = partial(
        align_similarity,
        a,
        Samples.of(a, b, num_points),
        num_steps=settings.num_steps,
        start_distance=start_distance,
        final_distance=leader.fine_final_distance,
        with_error=with_error,
    )
    return spread(lambda start: align(start.T_a_b, scale=start.scale), starts)


def _quick_scores(
    a: PreparedMap, b: PreparedMap, found: Sequence[Similarity], num_points: int, conflict_weight: float
) -> np.ndarray:
    """Scores of similarities (k,) by some voxels of both maps, whatever side of a surface they see."""
    total = np.zeros(len(found))
    if not len(found):
        return total
    T = np.stack([each.matrix for each in found])
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    for target, other, direction in ((a, b, T), (b, a, np.linalg.inv(T))):
        points = np.asarray(other.points)[sample_rows(other, num_points)]
        shares = score_poses(target.codes, target.block, points, weights, direction.astype(np.float32))
        total += np.asarray(shares) @ np.asarray([1.0, -conflict_weight, 0.0], np.float32)
    return total


def is_other_scale(found: Similarity, settings: CauseConfig, *, is_clear: bool = False) -> bool:
    """Whether a scale differs from 1 by more than small errors of maps, and by more than its own error.

    Far outside of the scales that are searched alignment has shrunk map b onto a single surface.

    Args:
        found: The similarity.
        settings: How much is more.
        is_clear: Ask for more of its own errors.
    """
    return _is_away(found, settings.num_clear_errors if is_clear else settings.num_errors, settings)


def may_be_other_scale(found: Similarity, settings: CauseConfig) -> bool:
    """Whether a scale differs from 1 by so much that nobody can rely on a pose of the map as it is.

    Drift alone puts scales of right poses away from 1 by 1 % and two of their errors.

    Args:
        found: The similarity.
        settings: How much is too much.
    """
    is_far = bool(abs(np.log(found.scale)) > 2.0 * settings.min_scale)
    return is_other_scale(found, settings) or (
        is_far and _is_away(found, settings.num_doubted_errors, settings)
    )


def is_any_scale(found: Similarity, settings: CauseConfig) -> bool:
    """Whether alignment has shrunk or blown up map b: what agrees leaves its size open, as a single corner would.

    Args:
        found: The similarity that alignment leads to from a pose of the map as it is.
        settings: How far scales are looked for.
    """
    return bool(abs(np.log(found.scale)) > 2.0 * settings.scale_step)


def _is_away(found: Similarity, num_errors: float, settings: CauseConfig) -> bool:
    """Whether a scale is away from 1 by so many of its errors, and by more than small errors of maps."""
    change = abs(np.log(found.scale))
    least = max(settings.min_scale, num_errors * found.log_error)
    return bool(least < change <= 2.0 * settings.scale_step)


def scaled_finding(
    finding: Finding, given: Leaders, scaled: Leaders, found: Finding, similarity: Similarity
) -> Finding:
    """The verdict on a pose where map b explains the maps better with another scale.

    Args:
        finding: The verdict on the pose of map b as it is.
        given: Leaders of the maps as they are.
        scaled: Leaders of map a and the scaled map b.
        found: The verdict on the first of these.
        similarity: The scale.
    """
    size = 1.0 / similarity.scale - 1.0
    reason = (
        f"Map b seems to be {'larger' if size > 0 else 'smaller'} by {100 * abs(size):.1f} %: with its lengths times "
        f"{similarity.scale:.4f} it lies in map a with a strength of {best_strength(scaled):.2f} and "
        f"{100 * conflict_share(scaled.judgement):.1f} % of what meets in conflict, as it is with "
        f"{best_strength(given):.2f} and {100 * conflict_share(given.judgement):.1f} %; bring both maps to metres "
        "(voxjax convert --scale, VoxelGrid.placed)."
    )
    # At most one of both is right.
    return Finding("ambiguous", min(finding.confidence, 1.0 - found.confidence), reason, finding.none)


def doubted_scale_finding(finding: Finding, similarity: Similarity) -> Finding:
    """The verdict on an accepted pose where map b may have another scale.

    Args:
        finding: The verdict before.
        similarity: The scale, which explains the maps as well.
    """
    size = 1.0 / similarity.scale - 1.0
    reason = (
        f"Map b may be {'larger' if size > 0 else 'smaller'} by {100 * abs(size):.1f} % (standard error "
        f"{100 * similarity.log_error:.1f} %), which explains the maps as well as the scale that it has: bring both "
        "maps to metres (voxjax convert --scale, VoxelGrid.placed), or give larger maps, which show the scale better."
    )
    return finding._replace(verdict="ambiguous", confidence=min(finding.confidence, 0.5), reason=reason)


def any_scale_finding(finding: Finding) -> Finding:
    """The verdict on an accepted pose under which any scale of map b agrees as well.

    Args:
        finding: The verdict before.
    """
    reason = (
        "What agrees would agree as well if map b had another size, as walls of a single corner would, and "
        "those of other places do; what would help are maps that share more of the place."
    )
    return finding._replace(verdict="ambiguous", confidence=min(finding.confidence, 0.5), reason=reason)
