"""`Registration` put together from what the stages found."""

from typing import Any

import numpy as np

from .._results import RESULTS
from ..refinement.outcome import Refinement
from ..registration.judging.judgement import Judgement
from ..registration.judging.leaders import Leaders
from ..registration.judging.rivals import net_strengths
from ..registration.judging.settings import VerdictConfig
from ..registration.judging.verdict import Finding, support
from ..registration.types import Evidence, Hypothesis, Registration


def nothing_found(reason: str, result: RESULTS, stats: dict[str, Any] | None = None) -> Registration:
    """Outcome when there is no pose to speak of.

    Args:
        reason: One sentence for a person.
        result: How the computation ended.
        stats: What was counted before; None where nothing was looked at.
    """
    counts = {"num_corners_a": 0, "num_corners_b": 0} if stats is None else stats
    return Registration(
        # A pose is there whatever the verdict is, so that reports have one shape; the covariance says that it
        # means nothing.
        T_a_b=np.eye(4),
        verdict="no_overlap",
        confidence=0.0,
        covariance=np.full((6, 6), np.inf, np.float32),
        hypotheses=(),
        reason=reason,
        result=result,
        stats={"num_associations": 0, "clique_size": 0, "num_hypotheses": 0, "seconds": {}} | counts,
    )


def registration_of(
    pose: Refinement,
    leaders: Leaders,
    finding: Finding,
    settings: VerdictConfig,
    *,
    num_voxels: int,
    stats: dict[str, Any],
) -> Registration:
    """Outcome with a pose, accepted or not.

    Args:
        pose: The best leader after the last refinement.
        leaders: Distinct poses, best first.
        finding: The verdict.
        settings: Share of the best score from which on a pose is a rival.
        num_voxels: Number of occupied voxels of both maps.
        stats: Counts and seconds for the report.
    """
    # The first leader was refined once more, and only its pose changed: evidence and score are those of the judging.
    T_a_b = np.asarray(pose.T_a_b)
    scores = net_strengths(leaders.judgement, settings)
    hypotheses = tuple(
        Hypothesis(
            T_a_b if i == 0 else leaders.poses[i],
            float(scores[i]),
            leaders.sources[i],
            evidence_of(leaders.judgement, i, num_voxels),
        )
        for i in range(len(scores))
    )
    result = {
        "accepted": RESULTS.successful,
        "ambiguous": RESULTS.ambiguous,
        "no_overlap": RESULTS.no_overlap,
    }
    return Registration(
        T_a_b=T_a_b,
        verdict=finding.verdict,
        confidence=finding.confidence,
        covariance=np.asarray(pose.covariance),
        hypotheses=hypotheses,
        reason=finding.reason,
        result=result[finding.verdict],
        stats={
            "num_associations": 0,
            "clique_size": 0,
            "source": leaders.sources[0],
            "tried_strengths": leaders.tried.strengths.tolist(),
        }
        | stats,
    )


def evidence_of(judgement: Judgement, i: int, num_voxels: int) -> Evidence:
    """What both maps say about pose i, in shares of the voxels that met anything, and in voxels of both maps."""
    # Where no voxel met anything, all shares are 0.
    # The shares are of what was met: leverage makes voxels count unequally, but cancels here.
    met = max(float(judgement.hits[i] + judgement.conflicts[i] + judgement.opposed[i]), 1e-9)
    return Evidence(
        score=float(judgement.score()[i]),
        occupied_agreement=float(judgement.hits[i] / met),
        free_conflict=float(judgement.conflicts[i] / met),
        num_hits=round(float(judgement.hits[i]) * num_voxels),
        num_conflicts=round(float(judgement.conflicts[i]) * num_voxels),
        support=float(support(judgement)[i]),
        shared_area=float(judgement.shared[i]),
        contradiction_area=float(judgement.pieces[i]),
    )
