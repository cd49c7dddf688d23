"""What occupied and free space say about the paper's schemes, and a plain rule for a verdict that the paper lacks."""

import numpy as np

from ... import rigid
from ..._results import RESULTS
from ...grid import VoxelGrid
from ...maps.prepared import PreparedMap, prepare_map
from ...ops.evidence.scoring import score_poses
from ...refinement.refine import refine
from ..hypotheses.distinct import least_trace
from ..types import Evidence, Hypothesis, Registration, Verdict
from .settings import PaperConfig


def judge_schemes(
    a: VoxelGrid,
    b: VoxelGrid,
    poses: np.ndarray,
    counts: np.ndarray,
    *,
    size: int,
    settings: PaperConfig,
    conflict_weight: float,
) -> Registration:
    """A registration from the poses of tied schemes, without counts for the report.

    Args:
        a: First map.
        b: Second map, of the same voxel size.
        poses: `T_a_b` of each scheme (k, 4, 4), best first.
        counts: Voxels that each of them fuses (k,).
        size: Corners that each scheme matches.
        settings: What an accepted pose must reach.
        conflict_weight: How many hits a conflict outweighs.
    """
    prepared = prepare_map(a), prepare_map(b)
    hypotheses = _hypotheses(*prepared, poses, conflict_weight)
    score = hypotheses[0].score
    rival = _rival(poses, counts, np.asarray(prepared[1].centroid), a.voxel_size, settings)
    verdict, reason = _decide(size, score, rival, settings)
    return Registration(
        T_a_b=hypotheses[0].T_a_b,
        verdict=verdict,
        confidence=_confidence(verdict, size, score, rival),
        covariance=np.asarray(refine(*prepared, hypotheses[0].T_a_b).covariance),
        hypotheses=hypotheses,
        reason=reason,
        result=RESULTS.successful,
        stats={},
    )


def _hypotheses(
    a: PreparedMap, b: PreparedMap, poses: np.ndarray, conflict_weight: float
) -> tuple[Hypothesis, ...]:
    """The poses with what occupied and free space say about them, counted both ways over all voxels."""
    forth = _counts(a, b, poses)
    back = _counts(b, a, np.asarray(rigid.inverse(poses)))
    total = a.num_points + b.num_points
    result = []
    for T, (hits, conflicts, undecided) in zip(poses, forth + back, strict=True):
        known = max(hits + conflicts + undecided, 1.0)
        # Voxels are counted here, not weighed by leverage: the paper counts cubes.
        score = float((hits - conflict_weight * conflicts) / total)
        evidence = Evidence(score, float(hits / known), float(conflicts / known), int(hits), int(conflicts))
        result.append(Hypothesis(T, score, "subgraph", evidence))
    return tuple(result)


def _counts(target: PreparedMap, other: PreparedMap, poses: np.ndarray) -> np.ndarray:
    """Hits, conflicts and undecided voxels of `other` in `target` (n, 3)."""
    points = np.asarray(other.points)[: other.num_points]
    ones = np.ones(len(points), np.float32)
    return np.asarray(score_poses(target.codes, target.block, points, ones, poses), np.float64)


def _rival(
    poses: np.ndarray, counts: np.ndarray, centroid: np.ndarray, voxel_size: float, settings: PaperConfig
) -> float:
    """Fused voxels of the best scheme that puts b elsewhere, as a share of the winner's."""
    images = poses[:, :3, :3] @ centroid + poses[:, :3, 3]
    traces = np.einsum("kij,ij->k", poses[:, :3, :3], poses[0, :3, :3])
    is_far = np.linalg.norm(images - images[0], axis=1) > settings.distinct_voxels * voxel_size
    is_elsewhere = is_far | (traces < least_trace(settings.distinct_degrees))
    # Schemes that put b at one place are one answer, found from different corners.
    return float(counts[is_elsewhere].max(initial=0) / max(counts[0], 1))


def _decide(size: int, score: float, rival: float, settings: PaperConfig) -> tuple[Verdict, str]:
    """A plain rule; see `register_paper`."""
    shown = f"{size} corners match and the evidence of all voxels is {score:.2f}"
    if size < settings.min_matches or score < settings.min_evidence:
        needed = f"{settings.min_matches} and {settings.min_evidence} are needed"
        return "no_overlap", f"Too little speaks for the best pose: {shown} ({needed})."
    if rival > settings.max_rival:
        return "ambiguous", f"Another scheme of equal size fuses {100 * rival:.0f} % as many voxels: {shown}."
    return "accepted", f"The largest scheme is supported: {shown}."


def _confidence(verdict: Verdict, size: int, score: float, rival: float) -> float:
    """Rough, not calibrated: more matches and more evidence are better; below 0.5 unless accepted."""
    trust = float(np.clip(score / 0.3, 0.0, 1.0)) * size / (size + 3.0) * (1.0 - 0.5 * rival)
    # A pose that was refused must not look more probable than one that was accepted.
    return trust if verdict == "accepted" else min(trust, 0.4)
