"""The verdict: is the best pose right, could another one be, or is there no overlap worth the name?

What separates right from wrong is measured by `bench/registration.py`: a wrong pose between different buildings hits
along one direction (storeys of equal height) and next to nothing along the worst one, because surfaces that face the
other way are no hits; repeated rooms give rivals that score almost the same.
"""

from typing import NamedTuple

import numpy as np

from .leaders import CONFLICT_WEIGHT, Judgement
from .types import Verdict


class Finding(NamedTuple):
    """The verdict with what it rests on.

    Attributes:
        verdict: "accepted", "ambiguous" or "no_overlap".
        confidence: Estimated probability that the pose is right.
        reason: One sentence.
    """

    verdict: Verdict
    confidence: float
    reason: str


def support(judgement: Judgement) -> np.ndarray:
    """Agreement along the worst direction (k,), net of conflicts: 1 when all surfaces of both maps agree.

    The information of the hits is 1/3 of the identity when everything agrees; conflicts are taken off as if they
    all spoke against that direction.
    """
    weakest = 3.0 * np.linalg.eigvalsh(judgement.information)[:, 0]
    kept = 1.0 - CONFLICT_WEIGHT * judgement.conflicts / np.maximum(
        judgement.hits + judgement.conflicts, 1e-9
    )
    return weakest * np.clip(kept, 0.0, 1.0)


def decide(
    judgement: Judgement,
    *,
    has_free_space: bool,
    min_support: float,
    max_conflict: float,
    max_rival: float,
    min_support_without_free_space: float,
) -> Finding:
    """Decide about the first pose of a judgement whose poses are distinct and best first.

    Args:
        judgement: Evidence of the leaders.
        has_free_space: Whether both maps know free space.
        min_support: See `VerdictConfig`, as all that follow.
        max_conflict: Largest share of conflicts.
        max_rival: Largest relative score of another pose.
        min_support_without_free_space: For maps that know none.
    """
    if len(judgement.hits) == 0:
        return Finding("no_overlap", 0.0, "No source proposed a pose: the maps have too little structure.")
    strength = support(judgement)
    scores = judgement.score()
    needed = min_support if has_free_space else min_support_without_free_space
    conflict = float(judgement.conflicts[0] / max(judgement.hits[0] + judgement.conflicts[0], 1e-9))
    rival = float(max(scores[1], 0.0) / scores[0]) if len(scores) > 1 and scores[0] > 0 else 0.0
    confidence = _confidence(strength[0] / needed, conflict / max_conflict, rival / max_rival)
    shown = f"{100 * judgement.hits[0]:.0f} % of the surfaces agree, {100 * conflict:.1f} % of what meets conflicts"
    if scores[0] <= 0.0 or strength[0] < 0.5 * needed or conflict > 2.0 * max_conflict:
        return Finding(
            "no_overlap", min(confidence, 0.1), f"No pose is supported by the maps: at best {shown}."
        )
    if strength[0] < needed:
        return Finding(
            "ambiguous",
            min(confidence, 0.5),
            f"The best pose can slide along a direction that no surface fixes: {shown}.",
        )
    if conflict > max_conflict:
        return Finding(
            "ambiguous",
            min(confidence, 0.5),
            f"Occupied and free space contradict each other too often: {shown}.",
        )
    if rival > max_rival:
        return Finding(
            "ambiguous", min(confidence, 0.5),
            f"Another pose explains the maps almost as well ({100 * rival:.0f} % of the evidence): {shown}.",
        )  # fmt: skip
    return Finding(
        "accepted",
        confidence,
        f"One pose stands out: {shown}, the next best pose has {100 * rival:.0f} % of its evidence.",
    )


def _confidence(support_ratio: float, conflict_ratio: float, rival_ratio: float) -> float:
    """Logistic in the logarithmic distance to each bound: 1/2 where the product of the three margins is one."""
    margin = (
        2.0 * np.log(max(support_ratio, 1e-6))
        - np.log(max(conflict_ratio, 0.2))
        - 3.0 * np.log(max(rival_ratio, 0.2))
    )
    return float(1.0 / (1.0 + np.exp(-np.clip(margin, -30.0, 30.0))))
