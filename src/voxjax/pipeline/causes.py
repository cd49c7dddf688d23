"""What is wrong with map b where the verdict on its best pose leaves doubts: it is mirrored, or has another scale."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .._results import RESULTS
from ..registration.causes.handedness import (
    best_score,
    conflict_share,
    has_far_fewer_conflicts,
    is_better,
    is_questionable,
    mirrored_finding,
)
from ..registration.causes.scale import (
    any_scale_finding,
    best_similarity,
    doubted_scale_finding,
    is_any_scale,
    is_other_scale,
    may_be_other_scale,
    scaled_finding,
)
from ..registration.causes.similarity import Similarity, Start
from ..registration.hypotheses.changed_features import mirrored_features, scaled_features
from ..registration.hypotheses.map_features import MapFeatures, worse_free_space
from ..registration.hypotheses.pose_range import PoseRange
from ..registration.hypotheses.proposals import Proposals, propose_exhaustively
from ..registration.judging.judgement import judge_poses
from ..registration.judging.leaders import Leaders, Tried, find_leaders, merge_leaders
from ..registration.judging.rivals import weigh_rivals
from ..registration.judging.verdict import Finding
from .coarse import coarse_proposals, coarse_starts_of
from .config import Config
from .stage_times import Stages
from .wide import coarser_features, finer_factors, leaders_through_copies

Decide = Callable[[MapFeatures, Leaders], Finding]

LEAST_SHARE = 0.9
"""A changed map b that scores less than this share of map b as it is once it is roughly aligned explains no more: on
generated places and simulated buildings, the last alignment gained 4 % at most."""

HOPELESS = 0.9
"""Neither does one of which no roughly aligned pose is right with this probability: no such gain makes it likely."""


class Explained(NamedTuple):
    """A verdict after its causes were looked for.

    Attributes:
        finding: The verdict; that of before where no cause was found.
        result: What was found; None for nothing.
        stats: Figures of what was tried, for the report: "handedness", "scale".
    """

    finding: Finding
    result: RESULTS | None
    stats: dict[str, Any]


class Questioned(NamedTuple):
    """Two maps and what is said of them.

    Attributes:
        a: First map.
        b: Second map.
        leaders: Distinct poses, best first.
        finding: The verdict on the first.
        factor: How many times as wide voxels must be for the search of all translations (`needed_coarsening`).
    """

    a: MapFeatures
    b: MapFeatures
    leaders: Leaders
    finding: Finding
    factor: int = 1


def explain(pair: Questioned, *, decide: Decide, settings: Config, stages: Stages) -> Explained:
    """Look for what explains the maps better than the best pose of map b as it is, where something speaks against it.

    Args:
        pair: The maps, with their leaders and the verdict.
        decide: The verdict on leaders of map a and a changed map b, which is given.
        settings: Settings of the stages.
        stages: Keeps the seconds.
    """
    cause, finding = settings.cause, pair.finding
    with stages.measure("causes"):
        # This takes some hundredths of a second; a scale that is wrong by a few percent may contradict nothing.
        near = _similarity_of(pair.a, pair.b, [Start(1.0, pair.leaders.poses[0])], settings)
        is_contradicted = is_questionable(pair.leaders, finding, cause)
        # Beside an accepted pose nothing is searched with other scales.
        is_scaled = finding.verdict != "accepted" or (near is not None and is_other_scale(near[0], cause))
        stats = {"scale": _figures(near)}
        if not (is_contradicted or is_scaled):
            return Explained(_with_doubts(pair, near, settings), None, stats)
        stages.announce("causes")
        if is_contradicted:
            mirrored = _mirrored(pair, decide, settings, stages)
            if mirrored.result is not None:
                return mirrored
            stats |= mirrored.stats
        scaled = Explained(finding, None, {})
        if is_scaled:
            scaled = _scaled(pair, decide, settings, stages)
        if scaled.result is None:
            scaled = scaled._replace(finding=_with_doubts(pair, near, settings))
        return scaled._replace(stats=stats | scaled.stats)


def _with_doubts(pair: Questioned, near: tuple[Similarity, float] | None, settings: Config) -> Finding:
    """The verdict; ambiguous where an accepted pose leaves open how large map b is.

    Args:
        pair: The maps, and what is said of them.
        near: The scale at the first pose, and how well it explains the maps.
        settings: Settings of the stages.
    """
    finding = pair.finding
    if finding.verdict != "accepted" or near is None:
        return finding
    if is_any_scale(near[0], settings.cause):
        return any_scale_finding(finding)
    if not may_be_other_scale(near[0], settings.cause):
        return finding
    # Judged by the same voxels as the similarity.
    given = _roughly_judged(pair.a, pair.b, pair.leaders.poses[:1], settings)
    return finding if near[1] <= best_score(given) else doubted_scale_finding(finding, near[0])


def _mirrored(pair: Questioned, decide: Decide, settings: Config, stages: Stages) -> Explained:
    """The verdict after the mirror image of map b was searched for in map a."""
    given, finding = pair.leaders, pair.finding
    image = mirrored_features(pair.b)
    mirrored = _leaders_of(pair, image, decide, settings, stages)
    if finding.verdict == "accepted" and worse_free_space(pair.a, pair.b) != "observed" and pair.factor == 1:
        # Nothing that was seen speaks against the pose: its image is looked for as thoroughly as it was.
        mirrored = _with_finer_search(pair.a, image, mirrored, settings)
    found = decide(image, mirrored)
    figures = {
        "score": best_score(given),
        "mirrored_score": best_score(mirrored),
        "mirrored_conflict": conflict_share(mirrored.judgement),
        "mirrored_confidence": found.confidence,
    }
    is_clear = has_far_fewer_conflicts(given, mirrored)
    if not is_better(finding, given, mirrored, found, settings.cause, is_clear=is_clear):
        return Explained(finding, None, {"handedness": figures})
    return Explained(
        mirrored_finding(finding, given, mirrored, found), RESULTS.mirrored, {"handedness": figures}
    )


def _scaled(pair: Questioned, decide: Decide, settings: Config, stages: Stages) -> Explained:
    """The verdict after map b was aligned with a scale, from its best poses and, where none is sure, from a search."""
    cause, given, finding = settings.cause, pair.leaders, pair.finding
    starts = [Start(1.0, pose) for pose in given.poses[: cause.num_judged]]
    a, b = (coarser_features(each, pair.factor, settings) for each in (pair.a, pair.b))
    if finding.verdict != "accepted":
        scales = np.exp(cause.scale_step * np.arange(-1, 2)).tolist()
        starts += coarse_starts_of(a, b, scales, cause.num_starts, settings)
    best = _similarity_of(a, b, starts, settings)
    if best is not None and pair.factor > 1:
        best = _similarity_of(pair.a, pair.b, [best[0].start], settings)
    figures = _figures(best) | {"score": best_score(given)}
    if best is None or not is_other_scale(best[0], cause) or best[1] < LEAST_SHARE * best_score(given):
        return Explained(finding, None, {"scale": figures})
    best = best[0]
    changed = scaled_features(pair.b, best.scale)
    # What chance gives is much the same for the map as it is, so that a scale that explains no more is let go of soon.
    alone = _roughly_judged(pair.a, changed, best.T_a_b[None], settings)._replace(tried=given.tried)
    if decide(changed, alone).none > HOPELESS:
        return Explained(finding, None, {"scale": figures})
    # As all poses are: other ones of the scaled map may score as well.
    scaled = _leaders_of(pair, changed, decide, settings, stages, guess=best.T_a_b)
    found = decide(changed, scaled)
    figures |= {"scaled_score": best_score(scaled), "scaled_confidence": found.confidence}
    is_clear = is_other_scale(best, cause, is_clear=True)
    if not is_better(finding, given, scaled, found, cause, is_clear=is_clear):
        return Explained(finding, None, {"scale": figures})
    return Explained(scaled_finding(finding, given, scaled, found, best), RESULTS.scaled, {"scale": figures})


def _similarity_of(
    a: MapFeatures, b: MapFeatures, starts: Sequence[Start], settings: Config
) -> tuple[Similarity, float] | None:
    """`best_similarity` with the settings of all stages."""
    weight = settings.evidence.conflict_weight
    return best_similarity(
        a, b, starts, settings=settings.cause, leader=settings.leader, conflict_weight=weight
    )


def _figures(found: tuple[Similarity, float] | None) -> dict[str, float]:
    """A scale and its error as the report gives them; without one, nothing is known of it."""
    if found is None:
        return {"scale": 1.0, "log_error": np.inf}
    return {"scale": found[0].scale, "log_error": found[0].log_error}


def _leaders_of(
    pair: Questioned,
    changed: MapFeatures,
    decide: Decide,
    settings: Config,
    stages: Stages,
    *,
    guess: np.ndarray | None = None,
) -> Leaders:
    """Leaders of a changed map b; the best pose alone, roughly judged, where it is clear that it explains no more.

    Args:
        pair: The maps as they are, and what is said of them.
        changed: The changed map b.
        decide: The verdict on leaders of map a and the changed one.
        settings: Settings of the stages.
        stages: Keeps the seconds.
        guess: A pose (4, 4) of the changed map where one is known, beside which the search finds its rivals.
    """
    least = LEAST_SHARE * best_score(pair.leaders)
    # What the caller knows of the pose holds for the map as it is, and not for another one.
    anywhere = PoseRange(np.asarray(changed.prepared.centroid))
    a, b = (coarser_features(each, pair.factor, settings) for each in (pair.a, changed))
    proposed = coarse_proposals(a, b, settings, pose_range=anywhere, guess=guess)
    leaders = _searched(a, b, proposed, decide, least, settings)
    if pair.factor > 1 and best_score(leaders) >= least:
        factors = finer_factors(pair.factor)
        leaders = leaders_through_copies(
            pair.a, changed, leaders, factors, settings=settings, stages=stages, pose_range=anywhere
        )
        leaders = weigh_rivals(pair.a, changed, leaders, settings.verdict)
    return leaders


def _searched(
    a: MapFeatures, b: MapFeatures, proposed: Proposals, decide: Decide, least: float, settings: Config
) -> Leaders:
    """Leaders among aligned poses; the best alone, roughly judged, if it scores less than `least` or is hopeless."""
    leader = settings.leader
    if len(proposed.poses):
        rough = _roughly_judged(a, b, proposed.poses, settings)
        if best_score(rough) < least or decide(b, rough).none > HOPELESS:
            return rough
    fewer = replace(leader, num_refined=min(leader.num_refined, settings.cause.num_refined))
    leaders = find_leaders(a.prepared, b.prepared, proposed, fewer, settings.evidence)
    return weigh_rivals(a, b, leaders, settings.verdict)


def _with_finer_search(a: MapFeatures, b: MapFeatures, leaders: Leaders, settings: Config) -> Leaders:
    """Leaders with those of the exhaustive search in its finest cells."""
    proposed = propose_exhaustively(
        a,
        b,
        settings.source,
        max_lean=None,
        conflict_weight=settings.evidence.coarse_conflict_weight,
        rotation=settings.rotation,
        exhaustive=settings.exhaustive,
    )
    found = find_leaders(a.prepared, b.prepared, proposed, settings.leader, settings.evidence)
    both = merge_leaders(a.prepared, b.prepared, leaders, found, settings.leader)
    return weigh_rivals(a, b, both, settings.verdict)


def _roughly_judged(a: MapFeatures, b: MapFeatures, poses: np.ndarray, settings: Config) -> Leaders:
    """The best of some aligned poses by some voxels of both maps, as the only leader."""
    leader, weight = settings.leader, settings.evidence.conflict_weight
    judged = judge_poses(
        a.prepared, b.prepared, poses, num_points=leader.num_rough_judges, conflict_weight=weight
    )
    best = np.argsort(-judged.score(), kind="stable")[:1]
    sources = ("exhaustive",) * len(poses)
    return Leaders(poses, judged, sources, Tried(poses, judged.strength())).take(best)
