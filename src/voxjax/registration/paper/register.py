"""The pipeline of the paper from two maps to a pose (sections III and IV), as the preset `paper`."""

import time

import numpy as np

from ... import rigid
from ..._checks import check_positive
from ..._results import RESULTS
from ...features.corners import Corners, detect_corners
from ...grid import VoxelGrid
from ...maps.prepared import PreparedMap, prepare_map
from ...matching.backtracking import backtrack
from ...matching.common_subgraph import close_corners
from ...matching.consistency import consistency_graph
from ...ops.evidence.scoring import score_poses
from ...refinement.refine import refine
from ..types import Evidence, Hypothesis, Registration, Verdict
from .matched_points import NeighbouringPoints, align_matches
from .tie_break import select_scheme

DISTANCE_TOLERANCE = 2.0
"""D of equation (4) [voxel]; the paper gives no value."""

NEIGHBOUR_RADIUS = 7.0
"""How far the neighbouring points of a corner reach [voxel]: once the window of section III."""

MAX_CORNERS = 128
"""Corners of a map that are matched; the strongest. The paper matched 82 with 88."""

MAX_NODES = 2_000_000
"""Budget of the backtracking: about 10 seconds."""

MIN_MATCHES = 6
"""One more than any five matches, whose transform the search starts from."""

CONFLICT_WEIGHT = 6.0
MIN_EVIDENCE = 0.1
"""Wrong poses between different buildings reached 0.05 in trials where hits and conflicts were counted."""

MAX_HYPOTHESES = 16
"""Tied schemes that are reported."""

MAX_RIVAL = 0.8
"""A tied scheme elsewhere that fuses this share of the voxels makes the answer ambiguous."""


def register_paper(
    a: VoxelGrid,
    b: VoxelGrid,
    *,
    distance_tolerance: float | None = None,
    max_corners: int = MAX_CORNERS,
    max_nodes: int = MAX_NODES,
) -> Registration:
    """Register two maps as the paper does: corners, backtracking with early transform, tie-break, transform.

    The paper knows no verdict. Here a pose is accepted when at least six corners match, occupied and free
    space of both maps support it and no tied scheme with another pose fuses nearly as many voxels; the
    confidence is a rough figure.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        distance_tolerance: D of equation (4) [m]; None takes two voxels.
        max_corners: Strongest corners of each map to match.
        max_nodes: Budget of the backtracking; `RESULTS.budget_exhausted` when it is spent.

    Returns:
        The registration; its result says which step failed, if one did.

    Raises:
        InputError: If the tolerance is not positive.

    References:
        Sections III and IV.
    """
    voxel = max(a.voxel_size, b.voxel_size)
    a, b = a.with_voxel_size(voxel), b.with_voxel_size(voxel)
    tolerance = DISTANCE_TOLERANCE * voxel if distance_tolerance is None else distance_tolerance
    check_positive("distance_tolerance", tolerance, "m")
    if not a.num_occupied or not b.num_occupied:
        return _failure(RESULTS.empty_map, {})

    # Section III: corners.
    clock = _Clock()
    corners_a, corners_b = (_strongest(detect_corners(m, preset="paper"), max_corners) for m in (a, b))
    stats = {"num_corners_a": len(corners_a.position), "num_corners_b": len(corners_b.position)}
    clock.lap("corners")
    if min(stats.values()) < 3:
        return _failure(RESULTS.too_few_corners, stats | clock.stats)

    # Section IV.B-C: compatibility of all associations, then the largest schemes by backtracking.
    graph = consistency_graph(corners_a, corners_b, distance_tolerance=tolerance)
    clock.lap("consistency")
    voxels_b = b.occupied_points()
    neighbours = NeighbouringPoints(a.occupied_points(), voxels_b, voxel)
    early_align = neighbours.early_align()
    points_a, points_b = np.asarray(corners_a.position), np.asarray(corners_b.position)
    masks = np.asarray(corners_a.mask), np.asarray(corners_b.mask)
    found = backtrack(
        graph.associations[: graph.num_associations],
        graph.adjacency,
        extend=close_corners(points_a, points_b, *masks, tolerance, early_align),
        max_nodes=max_nodes,
    )
    size = len(found.schemes[0])
    stats |= {"num_associations": graph.num_associations, "clique_size": size, "num_nodes": found.num_nodes}
    stats |= {"num_hypotheses": len(found.schemes), "search_completed": found.completed}
    clock.lap("search")
    if size < 3:
        return _failure(RESULTS.too_few_associations, stats | clock.stats)

    # Section IV.C: of tied schemes the one with most fused voxels.
    matched = [(points_a[scheme[:, 0]], points_b[scheme[:, 1]]) for scheme in found.schemes]
    best, poses, counts = select_scheme(
        a, voxels_b, found.schemes, lambda s: early_align(points_a[s[:, 0]], points_b[s[:, 1]])
    )
    clock.lap("tie-break")
    # Section IV.D and V.B: the transform from the matches and their neighbouring points.
    poses[best] = align_matches(*matched[best], neighbours, radius=NEIGHBOUR_RADIUS * voxel)[0]
    clock.lap("transform")
    prepared = prepare_map(a), prepare_map(b)
    order = np.argsort(-counts, kind="stable")[:MAX_HYPOTHESES]
    hypotheses = _hypotheses(*prepared, poses[order])
    covariance = refine(*prepared, hypotheses[0].T_a_b).covariance
    clock.lap("evidence")
    rival = _rival(poses[order], counts[order], np.asarray(prepared[1].centroid), 5.0 * voxel)
    verdict, reason = _decide(size, hypotheses[0].score, rival)
    return Registration(
        T_a_b=hypotheses[0].T_a_b,
        verdict=verdict,
        confidence=_confidence(verdict, size, hypotheses[0].score, rival),
        covariance=np.asarray(covariance),
        hypotheses=hypotheses,
        reason=reason
        if found.completed
        else f"{reason} The search stopped at its budget of {max_nodes} nodes.",
        result=RESULTS.successful if found.completed else RESULTS.budget_exhausted,
        stats=stats | clock.stats,
    )


class _Clock:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now

    @property
    def stats(self) -> dict:
        return {"seconds": self.seconds}


def _strongest(corners: Corners, count: int) -> Corners:
    """The listed corners, at most `count`; they come strongest first."""
    listed = corners.trimmed()
    rows = {f: getattr(listed, f)[:count] for f in ("position", "normals", "weight", "convexity", "mask")}
    return Corners(**rows, is_observed=listed.is_observed[:count], num_found=listed.num_found)


def _hypotheses(a: PreparedMap, b: PreparedMap, poses: np.ndarray) -> tuple[Hypothesis, ...]:
    """The poses with what occupied and free space say about them, counted both ways over all voxels."""
    forth = _counts(a, b, poses)
    back = _counts(b, a, rigid.inverse(poses))
    total = a.num_points + b.num_points
    result = []
    for T, (hits, conflicts, undecided) in zip(poses, forth + back, strict=True):
        known = max(hits + conflicts + undecided, 1.0)
        score = float((hits - CONFLICT_WEIGHT * conflicts) / total)
        evidence = Evidence(score, float(hits / known), float(conflicts / known), int(hits), int(conflicts))
        result.append(Hypothesis(T, score, "subgraph", evidence))
    return tuple(result)


def _counts(target: PreparedMap, other: PreparedMap, poses: np.ndarray) -> np.ndarray:
    """Hits, conflicts and undecided voxels of `other` in `target` (n, 3)."""
    points = np.asarray(other.points)[: other.num_points]
    ones = np.ones(len(points), np.float32)
    return np.asarray(score_poses(target.codes, *target.block, points, ones, poses), np.float64)


def _rival(poses: np.ndarray, counts: np.ndarray, centroid: np.ndarray, distance: float) -> float:
    """Fused voxels of the best scheme that puts b elsewhere, as a share of the winner's."""
    images = poses[:, :3, :3] @ centroid + poses[:, :3, 3]
    traces = np.einsum("kij,ij->k", poses[:, :3, :3], poses[0, :3, :3])
    is_elsewhere = (np.linalg.norm(images - images[0], axis=1) > distance) | (
        traces < 1.0 + 2.0 * np.cos(np.radians(5.0))
    )
    return float(counts[is_elsewhere].max(initial=0) / max(counts[0], 1))


def _decide(size: int, score: float, rival: float) -> tuple[Verdict, str]:
    """A plain rule; see `register_paper`."""
    shown = f"{size} corners match and the evidence of all voxels is {score:.2f}"
    if size < MIN_MATCHES or score < MIN_EVIDENCE:
        return (
            "no_overlap",
            f"Too little speaks for the best pose: {shown} ({MIN_MATCHES} and {MIN_EVIDENCE} are needed).",
        )
    if rival > MAX_RIVAL:
        return "ambiguous", f"Another scheme of equal size fuses {100 * rival:.0f} % as many voxels: {shown}."
    return "accepted", f"The largest scheme is supported: {shown}."


def _confidence(verdict: Verdict, size: int, score: float, rival: float) -> float:
    """Rough, not calibrated: more matches and more evidence are better; below 0.5 unless accepted."""
    trust = float(np.clip(score / 0.3, 0.0, 1.0)) * size / (size + 3.0) * (1.0 - 0.5 * rival)
    return trust if verdict == "accepted" else min(trust, 0.4)


def _failure(result: RESULTS, stats: dict) -> Registration:
    """No pose."""
    filled = {
        "num_corners_a": 0,
        "num_corners_b": 0,
        "num_associations": 0,
        "clique_size": 0,
        "num_hypotheses": 0,
    }
    return Registration(
        T_a_b=np.eye(4, dtype=np.float32), verdict="no_overlap", confidence=0.0,
        covariance=np.eye(6, dtype=np.float32), hypotheses=(), reason=RESULTS[result], result=result,
        stats=filled | {"seconds": {}} | stats,
    )  # fmt: skip
