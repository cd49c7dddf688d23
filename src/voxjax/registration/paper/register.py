"""The pipeline of the paper from two maps to a pose (sections III and IV), as the preset `paper`."""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..._results import RESULTS
from ...features.corners import Corners, detect_corners
from ...grid import VoxelGrid
from ...matching.backtracking import backtrack
from ...matching.consistency import consistency_graph
from ...matching.early_transform import close_corners
from ..hypotheses.settings import EvidenceConfig
from ..types import Registration
from .matched_points import NeighbouringPoints, align_matches
from .settings import PaperConfig
from .tie_break import select_scheme
from .verdict import judge_schemes


def register_paper(
    a: VoxelGrid,
    b: VoxelGrid,
    settings: PaperConfig | None = None,
    *,
    conflict_weight: float = EvidenceConfig.conflict_weight,
) -> Registration:
    """Register two maps as the paper does: corners, backtracking with early transform, tie-break, transform.

    The paper knows no verdict. Here a pose is accepted when enough corners match, occupied and free space of both maps
    support it and no tied scheme elsewhere fuses nearly as many voxels; the confidence is a rough figure.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        settings: None for the defaults; the search ends with `RESULTS.budget_exhausted` when its budget is spent.
        conflict_weight: How many hits a conflict outweighs.

    Returns:
        The registration; its result says which step failed, if one did.

    References:
        Sections III and IV.
    """
    chosen = PaperConfig() if settings is None else settings
    # Counts of a window compare only between voxels of one size; details of the finer map cannot be made up in the
    # other.
    voxel = max(a.voxel_size, b.voxel_size)
    (a, origin_a), (b, origin_b) = (grid.with_voxel_size(voxel).localized() for grid in (a, b))
    if not a.num_occupied or not b.num_occupied:
        return _failure(RESULTS.empty_map, {})
    clock = _Clock()

    # Section III: corners.
    corners_a, corners_b = (_strongest(detect_corners(m, preset="paper"), chosen.max_corners) for m in (a, b))
    counts_of_corners = len(corners_a.position), len(corners_b.position)
    stats: dict[str, Any] = dict(zip(("num_corners_a", "num_corners_b"), counts_of_corners, strict=True))
    stats["seconds"] = clock.seconds
    clock.lap("corners")
    if min(counts_of_corners) < 3:
        return _failure(RESULTS.too_few_corners, stats)

    # Section IV.B-C: compatibility of all associations, then the largest schemes by backtracking.
    points_a, points_b = (np.asarray(c.position, np.float32) for c in (corners_a, corners_b))
    tolerance = chosen.distance_tolerance * voxel
    graph = consistency_graph(corners_a, corners_b, distance_tolerance=tolerance)
    clock.lap("consistency")
    # The search trees are built once: the early transform asks them thousands of times.
    voxels_a, voxels_b = (grid.occupied_points().astype(np.float32) for grid in (a, b))
    neighbours = NeighbouringPoints(voxels_a, voxels_b, voxel, settings=chosen)
    early_align = neighbours.early_align()
    masks = np.asarray(corners_a.mask), np.asarray(corners_b.mask)
    extend = close_corners(points_a, points_b, *masks, tolerance, early_align)
    associations = graph.associations[: graph.num_associations]
    found = backtrack(associations, graph.adjacency, extend=extend, max_nodes=chosen.max_nodes)
    size = len(found.schemes[0])
    stats |= {"num_associations": graph.num_associations, "clique_size": size, "num_nodes": found.num_nodes}
    stats |= {"num_hypotheses": len(found.schemes), "search_completed": found.completed}
    clock.lap("search")
    if size < 3:
        return _failure(RESULTS.too_few_associations, stats)

    # Section IV.C: of tied schemes the one with most fused voxels.
    best, poses, counts = select_scheme(
        a, neighbours.voxels_b, found.schemes, lambda s: early_align(points_a[s[:, 0]], points_b[s[:, 1]])
    )
    clock.lap("tie-break")

    # Section IV.D and V.B: the transform from the matches and their neighbouring points.
    first, second = found.schemes[best].T
    # Only the winner gets the exact transform; the other schemes keep that by which the tie was decided.
    poses[best], _ = align_matches(points_a[first], points_b[second], neighbours)
    clock.lap("transform")

    # What the paper leaves open: covariance and verdict.
    # The sort is stable and `argmax` takes the first of equals, so that the winner comes first here, too.
    order = np.argsort(-counts, kind="stable")[: chosen.max_hypotheses]
    options = {"size": size, "settings": chosen, "conflict_weight": conflict_weight}
    judged = judge_schemes(a, b, poses[order], counts[order], **options)
    clock.lap("evidence")
    judged = judged.from_local(origin_a, origin_b)
    return replace(judged if found.completed else _cut_short(judged, chosen.max_nodes), stats=stats)


def _cut_short(judged: Registration, max_nodes: int) -> Registration:
    """A registration whose search did not come to its end."""
    reason = f"{judged.reason} The search stopped at its budget of {max_nodes} nodes."
    return replace(judged, result=RESULTS.budget_exhausted, reason=reason)


class _Clock:
    """Keeps the seconds of each step.

    Attributes:
        seconds: {step: s}.
    """

    def __init__(self) -> None:
        """Begin the first step."""
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        """End a step and begin the next one."""
        now = time.perf_counter()
        self.seconds[step], self._last = now - self._last, now


def _strongest(corners: Corners, count: int) -> Corners:
    """The listed corners, at most `count`; they come strongest first."""
    listed = corners.trimmed()
    rows = {f: getattr(listed, f)[:count] for f in ("position", "normals", "weight", "convexity", "mask")}
    return Corners(**rows, is_observed=listed.is_observed[:count], num_found=listed.num_found)


def _failure(result: RESULTS, stats: dict) -> Registration:
    """No pose."""
    nothing = dict.fromkeys(
        ("num_corners_a", "num_corners_b", "num_associations", "clique_size", "num_hypotheses"), 0
    )
    return Registration(
        T_a_b=np.eye(4),
        verdict="no_overlap",
        confidence=0.0,
        covariance=np.full((6, 6), np.inf, np.float32),
        hypotheses=(),
        reason=RESULTS[result],
        result=result,
        stats=nothing | {"seconds": {}} | stats,
    )
