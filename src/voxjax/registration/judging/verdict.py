"""The verdict: which pose is right, how probable is that, or is there no overlap worth the name?

The model is a choice in two steps. First: is a leader right, or none of them? A leader i has the weight exp(u_i) with

    u_i = score * log(score_i) + support * log(support_i),

"none" has exp(none), and the probability of each is its share of the sum (a conditional logit). The support is the
agreement along the worst direction, which two storeys of different buildings do not have. Second, where free space is
known: the leaders that score about as well as the best (the rivals) stand in the first step as one, and among them the
contradictions decide, not the agreement: how much the maps should overlap is not known beforehand (`conflict_pieces`).
The coefficients were fitted by maximum likelihood on generated pairs of one building, of different buildings and of
equal rooms, with free space and without (`python -m bench verdict_fit`); `python -m bench calibration` holds the
probabilities against the truth on other ones.
"""

from typing import NamedTuple

import numpy as np

from ..types import Verdict
from .conflict_pieces import net_scores, rivals
from .judgement import Judgement
from .settings import VerdictConfig


class Coefficients(NamedTuple):
    """Coefficients of the model.

    Attributes:
        none: Weight of no overlap.
        score: Coefficient of the logarithm of the score.
        support: Coefficient of the logarithm of the support.
    """

    none: float
    score: float
    support: float


WITH_FREE_SPACE = Coefficients(none=-12.4, score=6.4, support=0.0)
WITHOUT_FREE_SPACE = Coefficients(none=-6.2, score=3.1, support=3.0)
"""Without free space nothing can speak against a pose, and chance agreement is large: the evidence must stand out.
Fitted on stripped pairs before free space was inferred; `verdict_fit` on others gave -6.5, 3.6, 4.0. The pairs that
still come here are half scans, of which there are none among generated ones."""


class Finding(NamedTuple):
    """The verdict with what it rests on.

    Attributes:
        verdict: "accepted", "ambiguous" or "no_overlap".
        confidence: Probability that the first pose is right.
        reason: One sentence for a person.
        none: Probability that no leader is right.
    """

    verdict: Verdict
    confidence: float
    reason: str
    none: float


def support(judgement: Judgement) -> np.ndarray:
    """Agreement along the worst direction (k,): 1 when all surfaces of both maps agree."""
    # Where everything agrees the information is a third of the identity, whose least eigenvalue is 1/3.
    return 3.0 * np.linalg.eigvalsh(judgement.information)[:, 0]


def log_evidence(judgement: Judgement) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms (k,) of score and support of each pose; below 0.001 and 0.0001 all poses are equally hopeless."""
    return np.log(np.maximum(judgement.score(), 1e-3)), np.log(np.maximum(support(judgement), 1e-4))


def probabilities(
    judgement: Judgement, settings: VerdictConfig | None = None, *, has_free_space: bool
) -> np.ndarray:
    """Probability (k + 1,) that no leader is right, and that each of them is.

    Args:
        judgement: Evidence of the leaders.
        settings: Which poses are rivals, and how much their scores weigh; None for the defaults.
        has_free_space: Whether both maps know free space.
    """
    chosen = VerdictConfig() if settings is None else settings
    weight = WITH_FREE_SPACE if has_free_space else WITHOUT_FREE_SPACE
    of_score, of_support = log_evidence(judgement)
    utility = weight.score * of_score + weight.support * of_support
    is_rival = rivals(judgement, chosen.min_rival_share)
    if has_free_space and is_rival.any():
        net = net_scores(judgement, chosen)
        within = np.where(is_rival, np.maximum(net, 0.0) ** chosen.rival_weight, 0.0)
        # Rivals whose net score is 0 have the logarithm of 0, which gives them no share.
        with np.errstate(divide="ignore"):
            # Together rivals weigh as much as the best of them alone: many poses of equal rooms are no more probable
            # than one against no overlap.
            shared = np.max(utility[is_rival]) + np.log(within / within.sum())
        utility = np.where(is_rival, shared, utility)
    utility = np.concatenate([[weight.none], utility])
    # The largest is taken off first: exponentials of large numbers would overflow, and shares do not change.
    shares = np.exp(utility - utility.max())
    return shares / shares.sum()


def decide(
    judgement: Judgement, settings: VerdictConfig, *, has_free_space: bool, is_inferred: bool = False
) -> Finding:
    """Decide about the first pose of a judgement whose poses are distinct and best first.

    Args:
        judgement: Evidence of the leaders.
        settings: What an accepted pose must reach.
        has_free_space: Whether both maps know free space.
        is_inferred: Whether free space of a map was inferred (`inferred_space`), which the reason mentions.
    """
    if len(judgement.hits) == 0:
        return Finding(
            "no_overlap", 0.0, "No source proposed a pose: the maps have too little structure.", 1.0
        )
    chance = probabilities(judgement, settings, has_free_space=has_free_space)
    none, confidence = float(chance[0]), float(chance[1])
    conflict = float(judgement.conflicts[0] / max(judgement.hits[0] + judgement.conflicts[0], 1e-9))
    shown = _shown(judgement, conflict, has_free_space=has_free_space, is_inferred=is_inferred)
    # No overlap is the answer where nothing supports the pose, or where it is both the likelier one and more
    # than an even bet; any other doubt makes the pose ambiguous.
    if net_scores(judgement, settings)[0] <= 0.0 or none > max(0.5, confidence):
        return Finding("no_overlap", confidence, f"No pose is supported by the maps: at best {shown}.", none)
    if conflict > settings.max_conflict:
        reason = f"Occupied and free space contradict each other too often: {shown}."
        return Finding("ambiguous", min(confidence, 0.5), reason, none)
    if support(judgement)[0] < settings.min_support:
        reason = f"The best pose can slide along a direction that no surface fixes: {shown}."
        return Finding("ambiguous", min(confidence, 0.5), reason, none)
    # Among equal rooms the cleanest pose may still be a false one, where the true one is not among the leaders.
    is_contested = bool(rivals(judgement, settings.min_rival_share)[1:].any())
    if is_contested and judgement.pieces[0] > settings.max_pieces * judgement.shared[0]:
        reason = (
            f"The best of several poses sets whole pieces of one map into free space of the other: {shown}."
        )
        return Finding("ambiguous", confidence, reason, none)
    needed = settings.min_confidence
    if is_contested and has_free_space:
        needed = settings.min_confidence_beside_rivals
    if confidence >= needed:
        reason = f"One pose stands out: {shown}; probability {confidence:.3f}."
        return Finding("accepted", confidence, reason, none)
    return Finding("ambiguous", confidence, _why_unsure(chance, shown), none)


def _shown(judgement: Judgement, conflict: float, *, has_free_space: bool, is_inferred: bool) -> str:
    """What speaks for the first pose and against it, and where the free space is from."""
    shown = f"{100 * judgement.hits[0]:.0f} % of the surfaces agree, {100 * conflict:.1f} % of what meets conflicts"
    if not has_free_space:
        return f"{shown}, free space unknown"
    return f"{shown}, free space inferred from what encloses it" if is_inferred else shown


def _why_unsure(chance: np.ndarray, shown: str) -> str:
    """Whether another pose or no pose at all is the likeliest way in which the first pose could be wrong."""
    none, confidence = chance[0], chance[1]
    rival = chance[2:].max(initial=0.0)
    if rival > none:
        return (
            "Another pose explains the maps almost as well "
            f"(probability {rival:.2f}, against {confidence:.2f} of the best): {shown}."
        )
    return f"The maps agree too little to be sure of a pose (probability {confidence:.2f}): {shown}."
