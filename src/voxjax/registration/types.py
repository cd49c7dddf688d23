"""What a registration gives: the pose, how far to trust it, and what else was possible."""

from dataclasses import replace
from typing import Literal

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float, Float32

from .._results import RESULTS
from .._types import Array
from ..frames import from_local

Verdict = Literal["accepted", "ambiguous", "no_overlap"]


class Evidence(eqx.Module):
    """How two maps agree under a pose; counted both ways, over all voxels.

    Attributes:
        score: Balanced evidence, at most 1; below 0 when conflicts outweigh hits.
        occupied_agreement: Share of the occupied voxels of both maps, among those that fall into known space of the
            other, that land on something occupied.
        free_conflict: Share of the same voxels that land in free space, well away from anything occupied.
        num_hits: Number of occupied voxels of both maps that land on something occupied of the other; where voxels
            are weighed by what they tell of the pose, the weighted share of them times their number.
        num_conflicts: Number that land in free space, counted alike.
        support: Agreement along the worst direction, 1 when all surfaces agree; near 0 where the pose can slide.
        shared_area: Surface of both maps that agrees [m^2]; 0 for poses that are no rivals for the first place.
        contradiction_area: Surface of both maps in conflicts that hang together [m^2]; 0 for poses that are no rivals.
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
        T_a_b: float64 (4, 4), maps points of b into a.
        score: What hypotheses of one pair are ordered by: balanced evidence, or where free space is not known what of
            it lies exactly on the other map's surface; net of whole pieces that contradict.
        source: What proposed it: "corner", "virtual corner", "subgraph", "descriptor", "exhaustive", "guess"
            (`registration/hypotheses/proposals.py`).
        evidence: The counts behind the score.
    """

    T_a_b: Float[np.ndarray, "4 4"]
    score: float
    source: str
    evidence: Evidence


class Registration(eqx.Module):
    """Outcome of `voxjax.register`.

    Attributes:
        T_a_b: float64 (4, 4): maps points of frame b into frame a, `p_a = T_a_b @ p_b`; the best hypothesis, also
            when it is not accepted; identity when there is none.
        verdict: "accepted", "ambiguous" or "no_overlap".
        confidence: Estimated probability that the pose is right, in [0, 1].
        covariance: float32 (6, 6) of the tangent (translation [m], rotation [rad]) about the centroid of map b
            expressed in frame a.
        hypotheses: Best first, distinct poses.
        reason: One sentence for a person.
        result: How the computation ended. Compare it, as in `found.result == vx.RESULTS.successful`: the text of a
            success is empty, so that it prints as `RESULTS<>`.
        stats: "num_associations", "clique_size", "num_hypotheses", "seconds" ({stage: s}), "free_space" ("observed",
            "inferred" or "unknown", the worse of both maps), "num_isolated_a" and "num_isolated_b" (occupied voxels far
            away from the rest of their map, which are left aside, `maps/isolated.py`), "voxel_size" at which the maps
            were compared [m] and "voxel_size_reason"; "scale" (what the lengths of map b would have to be multiplied
            by, and the standard error of its logarithm) and, where something spoke against the pose, "handedness"
            (scores of map b and of its mirror image); "verdict" (strength of the best pose, what chance reaches, what
            contradicts it, and how many poses rival it, `registration/judging/verdict.py`); "tried_strengths" (of all
            poses that the leaders were chosen from, from which chance is read off); "contradictions" where both maps
            know free space: things of one map that stand in free space of the other, as {"occupied_in": "a" or "b",
            "area" [m^2], "low" and "high" corner of the box around it in frame a [m]}; "num_corners_a" and
            "num_corners_b" only where corners were looked for, that is where the first round of hypotheses did not
            decide.
    """

    T_a_b: Float[Array, "4 4"]
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

    def from_local(
        self, origin_a: Float[np.ndarray, "3"], origin_b: Float[np.ndarray, "3"]
    ) -> "Registration":
        """The outcome for maps that were registered in local frames, in their own frames.

        The covariance is about the centroid of map b and does not change.

        Args:
            origin_a: Origin of a's local frame, in frame a [m].
            origin_b: Origin of b's local frame, in frame b [m].
        """
        hypotheses = tuple(
            replace(each, T_a_b=from_local(each.T_a_b, origin_a, origin_b)) for each in self.hypotheses
        )
        T_a_b = from_local(np.asarray(self.T_a_b), origin_a, origin_b)
        return replace(self, T_a_b=T_a_b, hypotheses=hypotheses)

    def __repr__(self) -> str:
        """One line: verdict, confidence, how far the pose moves and turns, and the reason."""
        # Under a transformation of JAX, or as a tree of other leaves, there are no values to show.
        if not isinstance(self.T_a_b, (np.ndarray, jax.Array)) or isinstance(self.T_a_b, Tracer):
            return f"Registration(verdict={self.verdict!r}, T_a_b={self.T_a_b})"
        T = np.asarray(self.T_a_b, np.float64)
        # From sine and cosine, either of which alone loses digits near 0 or 180 degrees.
        skew = T[:3, :3] - T[:3, :3].T
        turn = np.degrees(np.arctan2(np.linalg.norm(skew) / np.sqrt(8.0), (np.trace(T[:3, :3]) - 1.0) / 2.0))
        place = ", ".join(f"{value:.3f}" for value in T[:3, 3])
        return (
            f"Registration({self.verdict}, confidence {self.confidence:.3f}, translation [{place}] m, "
            f"turned by {turn:.2f} deg: {self.reason})"
        )

    @property
    def best_score(self) -> float:
        """Evidence of the best hypothesis; below everything when there is none."""
        return self.hypotheses[0].score if self.hypotheses else -np.inf
