"""`Registration` put together from what the stages found."""

import numpy as np

from .._results import RESULTS
from ..registration.judging.leaders import Judgement
from ..registration.judging.verdict import support
from ..registration.types import Evidence, Registration


def nothing_found(reason: str, result: RESULTS) -> Registration:
    """Outcome when there is no pose to speak of."""
    return Registration(
        T_a_b=np.eye(4, dtype=np.float32), verdict="no_overlap", confidence=0.0,
        covariance=np.full((6, 6), np.inf, np.float32), hypotheses=(), reason=reason, result=result,
        stats={"num_corners_a": 0, "num_corners_b": 0, "num_associations": 0, "clique_size": 0,
               "num_hypotheses": 0, "seconds": {}},
    )  # fmt: skip


def with_stats(found: Registration, stats: dict, seconds: dict[str, float]) -> Registration:
    """The outcome with counts for the report and the seconds of its stages."""
    return Registration(
        found.T_a_b, found.verdict, found.confidence, found.covariance, found.hypotheses, found.reason, found.result,
        stats | {"seconds": seconds},
    )  # fmt: skip


def evidence_of(judgement: Judgement, i: int, num_voxels: int) -> Evidence:
    """What both maps say about pose i, in shares of the voxels that met anything, and in voxels of both maps."""
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
