"""What a registration gives: the pose, how far to trust it, and what else was possible."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float32

from .._results import RESULTS
from .._types import Array

Verdict = Literal["accepted", "ambiguous", "no_overlap"]


class Evidence(eqx.Module):
    """How two maps agree under a pose; counted both ways, over all voxels.

    Attributes:
        score: Balanced evidence, at most 1; below 0 when conflicts outweigh hits.
        occupied_agreement: Share of the occupied voxels of both maps, among those that fall into known space of the
            other, that land on something occupied.
        free_conflict: Share of the same voxels that land in free space, well away from anything occupied.
        num_hits: Number of occupied voxels of both maps that land on something occupied of the other.
        num_conflicts: Number that land in free space.
        support: Agreement along the worst direction, 1 when all surfaces agree; near 0 where the pose can slide.
        shared_area: Surface of both maps that agrees [m^2]; 0 for poses that are no rivals for the first place.
        contradiction_area: Surface of both maps in conflicts that hang together, at least 1 m^2 each [m^2]; 0 for poses
            that are no rivals.
    """

    score: float
    occupied_agreement: float
    free_conflict: float
    num_hits: int
    num_conflicts: int
    support: float = 0.0
    shared_area: float = 0.0
    contradiction_area: float = 0.0


class Hypothesis(eqx.Module):
    """One candidate pose after refinement.

    Attributes:
        T_a_b: float32 (4, 4), maps points of b into a.
        score: Evidence score; comparable between hypotheses of one pair.
        source: What proposed it: "corner", "virtual corner", "subgraph", "descriptor", "exhaustive", "guess"
            (`registration/hypotheses/proposals.py`).
        evidence: The counts behind the score.
    """

    T_a_b: Float32[np.ndarray, "4 4"]
    score: float
    source: str
    evidence: Evidence


class Registration(eqx.Module):
    """Outcome of `voxjax.register`.

    Attributes:
        T_a_b: float32 (4, 4): maps points of frame b into frame a, `p_a = T_a_b @ p_b`; the best hypothesis, also
            when it is not accepted; identity when there is none.
        verdict: "accepted", "ambiguous" or "no_overlap".
        confidence: Estimated probability that the pose is right, in [0, 1].
        covariance: float32 (6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of map b
            expressed in frame a.
        hypotheses: Best first, distinct poses.
        reason: One sentence for a person.
        result: How the computation ended.
        stats: "num_corners_a", "num_corners_b", "num_associations", "clique_size", "num_hypotheses",
            "seconds" ({stage: s}), "free_space" ("observed", "inferred" or "unknown", the worse of both maps).
    """

    T_a_b: Float32[Array, "4 4"]
    verdict: Verdict
    confidence: float
    covariance: Float32[Array, "6 6"]
    hypotheses: tuple[Hypothesis, ...]
    reason: str
    result: RESULTS
    stats: dict

    @property
    def accepted(self) -> bool:
        """Whether the pose may be used without a person looking at it."""
        return self.verdict == "accepted"

    @property
    def best_score(self) -> float:
        """Evidence of the best hypothesis; below everything when there is none."""
        return self.hypotheses[0].score if self.hypotheses else -np.inf
