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
from .distinct import distinct_poses
from .settings import DescriptorConfig, SourceConfig

Matches = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def descriptor_hypotheses(
    a: MapDescriptors,
    b: MapDescriptors,
    *,
    max_hypotheses: int = SourceConfig.max_descriptor_poses,
    settings: DescriptorConfig | None = None,
) -> tuple[Float32[np.ndarray, "k 4 4"], Int32[np.ndarray, "k"]]:
    """Propose poses of map b in map a from matched descriptors.

    Args:
        a: Descriptors of map a.
        b: Descriptors of map b, of the same spacing and side.
        max_hypotheses: Most poses returned.
        settings: How descriptors are matched and cliques grown; None for the defaults.

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
    chosen = DescriptorConfig() if settings is None else settings
    matches = _collect_matches(a, b, chosen)
    count = len(matches[4])
    if count < 3:
        return np.zeros((0, 4, 4), np.float32), np.zeros(0, np.int32)
    # A clique is grown from every match, so that many give the same pose; only distinct ones are fitted further.
    poses, places = _rank_poses(_clique_poses(matches, chosen), matches, chosen)
    # The tolerance of a match is so many spacings of its level: the largest gives the coarsest spacing back.
    distance = chosen.distinct_spacings / chosen.distance_tolerance * float(matches[4].max())
    # The middle of the matches is where poses are compared: what they do beyond, the descriptors do not say.
    centroid = matches[2].mean(axis=0, dtype=np.float64).astype(np.float32)
    keep = distinct_poses(
        poses, centroid, degrees=chosen.distinct_degrees, metres=distance, max_count=max_hypotheses
    )
    poses, places = _rank_poses(poses[keep], matches, chosen, rounds=chosen.num_refits)
    # Poses that were refit to more matches may have come together.
    keep = distinct_poses(poses, centroid, degrees=chosen.distinct_degrees, metres=distance)
    poses, places = poses[keep], places[keep]
    return _uncentre(poses, np.asarray(a.center), np.asarray(b.center)), places


def _collect_matches(a: MapDescriptors, b: MapDescriptors, settings: DescriptorConfig) -> Matches:
    """Points and normals in a, points and normals in b, and tolerance [m] of the matches of all levels."""
    parts = []
    for level_a, level_b in _common_levels(a, b):
        rows, _ = match_descriptors(level_a, level_b)
        parts.append(
            (
                np.asarray(level_a.points)[rows[:, 0]],
                np.asarray(level_a.normals)[rows[:, 0]],
                np.asarray(level_b.points)[rows[:, 1]],
                np.asarray(level_b.normals)[rows[:, 1]],
                np.full(len(rows), settings.distance_tolerance * level_a.spacing, np.float32),
            )
        )
    x, n, y, m, tolerance = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _evenly((x, n, y, m, tolerance), settings.max_matches)


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


def _clique_poses(matches: Matches, settings: DescriptorConfig) -> np.ndarray:
    """Poses (p, 4, 4) of cliques of three and more matches, grown in the densest parts of the agreement."""
    # Memory and time of the agreement go with the square of the matches.
    matches = _evenly(matches, settings.max_compared)
    agreement = _agreement(matches, settings.cosine_tolerance)
    is_left = np.ones(len(agreement), bool)
    poses = []
    # Repeated rooms fill the densest part with false matches; the next part may hold the true ones.
    for _ in range(settings.num_parts):
        nodes = _densest(agreement, is_left, settings.max_nodes)
        if len(nodes) < 3:
            break
        poses.append(_poses_of_part(agreement, nodes, matches, settings))
        is_left[nodes] = False
    return np.concatenate([np.zeros((0, 4, 4), np.float32), *poses])


def _densest(agreement: np.ndarray, is_left: np.ndarray, max_nodes: int) -> np.ndarray:
    """The matches, among those left, that agree with the most others that are left; in order."""
    # Truth values become float32 here, because NumPy multiplies only floating matrices by a fast routine.
    degree = np.where(is_left, agreement @ is_left.astype(np.float32), 0.0)
    nodes = np.argsort(-degree, kind="stable")[:max_nodes]
    # A match of a clique of three agrees with two others.
    return np.sort(nodes[degree[nodes] >= 2.0])


def _poses_of_part(
    agreement: np.ndarray, nodes: np.ndarray, matches: Matches, settings: DescriptorConfig
) -> np.ndarray:
    """Poses of the cliques grown from each of some matches, within them."""
    size = wide_bucket_size(len(nodes), 256)
    dense = np.zeros((size, size), bool)
    dense[: len(nodes), : len(nodes)] = agreement[np.ix_(nodes, nodes)]
    members, sizes = map(np.asarray, greedy_cliques(dense))
    # Fewer than three matches fix no pose.
    seeds = np.argsort(-sizes[: len(nodes)], kind="stable")[: settings.max_seeds]
    seeds = seeds[sizes[seeds] >= 3]
    # One length for all parts, so that the poses of all of them share a kernel.
    width = wide_bucket_size(settings.max_nodes, 256)
    part = [pad_rows(values[nodes], width) for values in matches[:4]]
    weights = np.zeros((len(seeds), width), np.float32)
    weights[:, :size] = members[seeds]
    return _in_groups(partial(poses_from_matches, *part, normal_weight=_normal_weight(matches)), weights)


def _agreement(matches: Matches, cosine_tolerance: float) -> np.ndarray:
    """Agreement matrix of all matches, without padding."""
    count = len(matches[4])
    size = wide_bucket_size(count, 512)
    *sides, tolerance = (pad_rows(values, size) for values in matches)
    agreement = agreement_matrix(
        *sides, np.arange(size) < count, distance_tolerance=tolerance, cosine_tolerance=cosine_tolerance
    )
    return np.asarray(agreement)[:count, :count]


def _rank_poses(
    poses: np.ndarray, matches: Matches, settings: DescriptorConfig, rounds: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Refit each pose to all matches it explains; poses and their numbers of separate places, best first."""
    count = len(matches[4])
    # All pairs of maps get one length: another one would compile these kernels anew.
    *sides, tolerance = (pad_rows(values, settings.max_matches) for values in matches)
    mask = np.arange(settings.max_matches) < count

    def explain(some: np.ndarray) -> Array:
        return matches_under_poses(
            some, *sides, mask, distance_tolerance=tolerance, min_cosine=np.float32(settings.min_cosine)
        )

    refit = partial(poses_from_matches, *sides, normal_weight=_normal_weight(matches))
    # Each refit takes up what the pose before explained, and may so explain more.
    for _ in range(rounds):
        poses = _in_groups(refit, _in_groups(explain, poses).astype(np.float32))
    explained = _in_groups(explain, poses)[:, :count]
    places = _count_places(explained, matches)
    order = np.argsort(-places, kind="stable")
    # Matches at fewer than three separate places fix no pose.
    order = order[places[order] >= 3]
    return poses[order], places[order]


def _normal_weight(matches: Matches) -> np.float32:
    """Weight of a normal beside a point [m^2]: an error of 1 counts as much as the smallest tolerance."""
    return np.float32(float(matches[4].min()) ** 2)


def _in_groups(function: Callable[[np.ndarray], Array], rows: np.ndarray) -> np.ndarray:
    """A function of 64 rows applied to any number of them, side by side."""
    return over_pieces(lambda some, _: function(some), [rows], size=64)


def _count_places(explained: np.ndarray, matches: Matches) -> np.ndarray:
    """Number of separate cells, two tolerances wide in map a, that hold an explained match of each pose."""
    # Matches beside each other show the same piece of surface, and together say little more than one of them.
    cell = np.floor(matches[0] / (2.0 * matches[4].max())).astype(np.int64)
    _, cell = np.unique(cell, axis=0, return_inverse=True)
    hits = np.zeros((len(explained), int(cell.max()) + 1), bool)
    pose, match = np.nonzero(explained)
    hits[pose, cell.reshape(-1)[match]] = True
    return hits.sum(axis=1, dtype=np.int32)


def _uncentre(poses: np.ndarray, center_a: np.ndarray, center_b: np.ndarray) -> np.ndarray:
    """Poses between the maps' frames, of poses between their centred points."""
    # The centres of maps may lie far from the origins of their frames, where float32 would round products away.
    result = poses.astype(np.float64)
    result[:, :3, 3] += center_a.astype(np.float64) - result[:, :3, :3] @ center_b.astype(np.float64)
    return result.astype(np.float32)
