"""Candidate poses from matches of local descriptors: mutual matches, their agreement, cliques, poses."""

from collections.abc import Callable
from functools import partial

import numpy as np
from jaxtyping import Float32, Int32

from ..._checks import InputError
from ..._runtime.buckets import pad_rows, wide_bucket_size
from ..._runtime.pieces import over_pieces
from ..._types import Array
from ...matching.descriptors import DescriptorLevel, MapDescriptors, match_descriptors
from ...ops.descriptors.consensus import (
    agreement_matrix,
    greedy_cliques,
    matches_under_poses,
    poses_from_matches,
)

DISTANCE_TOLERANCE = 1.5
"""Largest error of a matched point, in working spacings: half a cell in each map, and the next cell."""
COSINE_TOLERANCE = 0.3
MIN_COSINE = 0.8
"""Largest difference of corresponding cosines of two matches; least cosine of matched normals under a pose."""
MAX_MATCHES = 4096
MAX_COMPARED = 2048
MAX_NODES = 1024
ROUNDS = 2
MAX_SEEDS = 512
"""Matches kept, those that are compared with each other, those of the densest part that seed cliques, how many such
parts are taken one after the other (repeated rooms fill the first with false matches), and cliques kept of each."""
DISTINCT_DEGREES = 10.0
DISTINCT_SPACINGS = 3.0
"""Poses nearer to each other than both are one hypothesis; refinement brings them together anyway."""

_GROUP = 64
"""Poses that a core fits at a time."""

Matches = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def descriptor_hypotheses(
    a: MapDescriptors, b: MapDescriptors, *, max_hypotheses: int = 16
) -> tuple[Float32[np.ndarray, "k 4 4"], Int32[np.ndarray, "k"]]:
    """Propose poses of map b in map a from matched descriptors.

    Args:
        a: Descriptors of map a.
        b: Descriptors of map b, of the same spacing and side.
        max_hypotheses: Most poses returned.

    Returns:
        Distinct poses `T_a_b` float32 (k, 4, 4), good to about one working spacing and a few degrees, and the
        number of separate places whose matches agree with each, best first; none when no three matches agree.

    Raises:
        InputError: If the descriptors have different spacings or sides, or `max_hypotheses` is below 1.
    """
    if a.side != b.side:
        raise InputError(
            f"descriptors must sign their normals alike in both maps, got {a.side!r} and {b.side!r}; "
            "describe both with use_free_space=False."
        )
    if max_hypotheses < 1:
        raise InputError(f"max_hypotheses must be 1 or more, got {max_hypotheses!r}.")
    matches = _collect_matches(a, b)
    count = len(matches[4])
    if count < 3:
        return np.zeros((0, 4, 4), np.float32), np.zeros(0, np.int32)
    poses, places = _rank_poses(_clique_poses(matches), matches)
    distance = DISTINCT_SPACINGS / DISTANCE_TOLERANCE * float(matches[4].max())
    centroid = matches[2].mean(axis=0, dtype=np.float64).astype(np.float32)
    keep = _distinct(poses, centroid, distance)[:max_hypotheses]
    poses, places = _rank_poses(poses[keep], matches, rounds=3)
    keep = _distinct(poses, centroid, distance)
    poses, places = poses[keep], places[keep]
    return _uncentre(poses, np.asarray(a.center), np.asarray(b.center)), places


def _collect_matches(a: MapDescriptors, b: MapDescriptors) -> Matches:
    """Points and normals in a, points and normals in b, and tolerance [m] of the matches of all levels."""
    parts = []
    for level_a, level_b in _common_levels(a, b):
        rows, _ = match_descriptors(level_a, level_b)
        parts.append((
            np.asarray(level_a.points)[rows[:, 0]], np.asarray(level_a.normals)[rows[:, 0]],
            np.asarray(level_b.points)[rows[:, 1]], np.asarray(level_b.normals)[rows[:, 1]],
            np.full(len(rows), DISTANCE_TOLERANCE * level_a.spacing, np.float32),
        ))  # fmt: skip
    x, n, y, m, tolerance = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _evenly((x, n, y, m, tolerance), MAX_MATCHES)


def _evenly(matches: Matches, limit: int) -> Matches:
    """At most `limit` matches, evenly chosen: the descriptor distance does not tell right from wrong ones."""
    count = len(matches[4])
    if count <= limit:
        return matches
    keep = np.linspace(0, count - 1, limit).astype(np.int64)
    x, n, y, m, tolerance = (part[keep] for part in matches)
    return x, n, y, m, tolerance


def _common_levels(a: MapDescriptors, b: MapDescriptors) -> list[tuple[DescriptorLevel, DescriptorLevel]]:
    """Levels of equal spacing."""
    pairs = [
        (x, y) for x in a.levels for y in b.levels if np.isclose(x.spacing, y.spacing, rtol=1e-5, atol=0.0)
    ]
    if not pairs:
        raise InputError(
            f"descriptors must have a spacing in common, got {[x.spacing for x in a.levels]} m and "
            f"{[y.spacing for y in b.levels]} m; describe both with spacing=working_spacing(voxel sizes)."
        )
    return pairs


def _clique_poses(matches: Matches) -> np.ndarray:
    """Poses (p, 4, 4) of cliques of three and more matches, grown in the densest parts of the agreement."""
    matches = _evenly(matches, MAX_COMPARED)
    agreement = _agreement(matches)
    is_left = np.ones(len(agreement), bool)
    poses = []
    for _ in range(ROUNDS):
        nodes = _densest(agreement, is_left)
        if len(nodes) < 3:
            break
        poses.append(_poses_of_part(agreement, nodes, matches))
        is_left[nodes] = False
    return np.concatenate([np.zeros((0, 4, 4), np.float32), *poses])


def _densest(agreement: np.ndarray, is_left: np.ndarray) -> np.ndarray:
    """The matches, among those left, that agree with the most others that are left; in order."""
    degree = np.where(is_left, agreement @ is_left.astype(np.float32), 0.0)
    nodes = np.argsort(-degree, kind="stable")[:MAX_NODES]
    return np.sort(nodes[degree[nodes] >= 2.0])


def _poses_of_part(agreement: np.ndarray, nodes: np.ndarray, matches: Matches) -> np.ndarray:
    """Poses of the cliques grown from each of some matches, within them."""
    size = wide_bucket_size(len(nodes), 256)
    dense = np.zeros((size, size), bool)
    dense[: len(nodes), : len(nodes)] = agreement[np.ix_(nodes, nodes)]
    members, sizes = map(np.asarray, greedy_cliques(dense))
    seeds = np.argsort(-sizes[: len(nodes)], kind="stable")[:MAX_SEEDS]
    seeds = seeds[sizes[seeds] >= 3]
    part = [pad_rows(values[nodes], MAX_NODES) for values in matches[:4]]
    weights = np.zeros((len(seeds), MAX_NODES), np.float32)
    weights[:, :size] = members[seeds]
    return _in_groups(partial(poses_from_matches, *part, normal_weight=_normal_weight(matches)), weights)


def _agreement(matches: Matches) -> np.ndarray:
    """Agreement matrix of all matches, without padding."""
    count = len(matches[4])
    size = wide_bucket_size(count, 512)
    *sides, tolerance = (pad_rows(values, size) for values in matches)
    agreement = agreement_matrix(
        *sides, np.arange(size) < count, distance_tolerance=tolerance, cosine_tolerance=COSINE_TOLERANCE
    )
    return np.asarray(agreement)[:count, :count]


def _rank_poses(poses: np.ndarray, matches: Matches, rounds: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Refit each pose to all matches it explains; poses and their numbers of separate places, best first."""
    count = len(matches[4])
    *sides, tolerance = (pad_rows(values, MAX_MATCHES) for values in matches)
    mask = np.arange(MAX_MATCHES) < count

    def explain(some: np.ndarray) -> Array:
        return matches_under_poses(
            some, *sides, mask, distance_tolerance=tolerance, min_cosine=np.float32(MIN_COSINE)
        )

    refit = partial(poses_from_matches, *sides, normal_weight=_normal_weight(matches))
    for _ in range(rounds):
        poses = _in_groups(refit, _in_groups(explain, poses).astype(np.float32))
    explained = _in_groups(explain, poses)[:, :count]
    places = _count_places(explained, matches)
    order = np.argsort(-places, kind="stable")
    order = order[places[order] >= 3]
    return poses[order], places[order]


def _normal_weight(matches: Matches) -> np.float32:
    return np.float32(float(matches[4].min()) ** 2)


def _in_groups(function: Callable[[np.ndarray], Array], rows: np.ndarray) -> np.ndarray:
    """A function of 64 rows applied to any number of them, side by side."""
    return over_pieces(lambda some, _: function(some), [rows], size=_GROUP)


def _count_places(explained: np.ndarray, matches: Matches) -> np.ndarray:
    """Number of separate cells, two tolerances wide in map a, that hold an explained match of each pose."""
    cell = np.floor(matches[0] / (2.0 * matches[4].max())).astype(np.int64)
    _, cell = np.unique(cell, axis=0, return_inverse=True)
    hits = np.zeros((len(explained), int(cell.max()) + 1), bool)
    pose, match = np.nonzero(explained)
    hits[pose, cell.reshape(-1)[match]] = True
    return hits.sum(axis=1, dtype=np.int32)


def _distinct(poses: np.ndarray, point: np.ndarray, distance: float) -> list[int]:
    """Rows of the poses, in order, that no kept pose is near to: by angle, and by where `point` goes."""
    kept: list[int] = []
    places = poses[:, :3, :3] @ point + poses[:, :3, 3]
    for row in range(len(poses)):
        traces = np.einsum("kij,ij->k", poses[kept, :3, :3], poses[row, :3, :3])
        angles = np.degrees(np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0)))
        offsets = np.linalg.norm(places[kept] - places[row], axis=1)
        if not np.any((angles < DISTINCT_DEGREES) & (offsets < distance)):
            kept.append(row)
    return kept


def _uncentre(poses: np.ndarray, center_a: np.ndarray, center_b: np.ndarray) -> np.ndarray:
    """Poses between the maps' frames, of poses between their centred points."""
    result = poses.astype(np.float64)
    result[:, :3, 3] += center_a.astype(np.float64) - result[:, :3, :3] @ center_b.astype(np.float64)
    return result.astype(np.float32)
