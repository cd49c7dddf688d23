"""Poses from corners: a single pair of corner frames, or the maximum common subgraph of all corners."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ... import rigid
from ...features.types import KIND_UNKNOWN, Corners
from ...matching.common_subgraph import maximum_common_subgraph
from .closed_form import align_points
from .settings import FrameConfig, SourceConfig, SubgraphConfig


class CornerPoses(NamedTuple):
    """Candidate poses from corner frames.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`.
        is_observed: (k,): whether both corners were observed.
    """

    poses: Float[np.ndarray, "k 4 4"]
    is_observed: np.ndarray


def corner_frames(normals: np.ndarray) -> np.ndarray:
    """Orthonormal frames (n, 3, 3), columns nearest to the three normals of each corner."""
    return np.asarray(rigid.nearest_rotation(np.swapaxes(normals.astype(np.float64), 1, 2)))


def frame_poses(
    a: Corners,
    b: Corners,
    *,
    angle_tolerance: float = FrameConfig.angle_tolerance,
    max_poses: int = FrameConfig.max_pairs,
) -> CornerPoses:
    """One pose for each pair of corners and each cyclic order of their normals.

    Pairs whose faces meet at different angles, or whose edges are convex on one side and concave on the other, are
    left out. Of more than `max_poses` the pairs with the largest product of weights are kept.

    Args:
        a: Corners of a.
        b: Corners of b.
        angle_tolerance: Largest difference between the angles of two faces [deg].
        max_poses: Largest number of poses.
    """
    a, b = a.trimmed(), b.trimmed()
    if len(a.mask) == 0 or len(b.mask) == 0:
        return CornerPoses(np.zeros((0, 4, 4), np.float32), np.zeros(0, bool))
    kind_a, kind_b = np.asarray(a.convexity)[:, None], np.asarray(b.convexity)[None, :]
    is_alike = (kind_a == kind_b) | (kind_a == KIND_UNKNOWN) | (kind_b == KIND_UNKNOWN)
    # Three normals are hardly ever exactly at right angles: the nearest frame takes the error from all three
    # alike.
    frames_a, angles_a = corner_frames(np.asarray(a.normals)), _face_angles(np.asarray(a.normals))
    found = []
    # Which face of b belongs to which of a is not known, but both maps list them right-handed: three cyclic orders
    # are left.
    for shift in range(3):
        normals_b = np.roll(np.asarray(b.normals), shift, axis=1)
        # Angles between faces do not change under any pose, so that they sort out pairs before a pose is made.
        gap = np.abs(angles_a[:, None, :] - _face_angles(normals_b)[None, :, :]).max(axis=2)
        # The frames are rolled with the normals: rows of both maps belong to each other in this order.
        i, j = np.nonzero(is_alike & (gap < np.radians(angle_tolerance)))
        rotation = frames_a[i] @ np.swapaxes(corner_frames(normals_b)[j], 1, 2)
        found.append((i, j, rotation))
    i, j = np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])
    rotation = np.concatenate([f[2] for f in found])
    # Every pose is scored by points of both maps, and corners of right angles nearly all agree with each other.
    if len(i) > max_poses:
        strength = np.asarray(a.weight)[i] * np.asarray(b.weight)[j]
        chosen = np.sort(np.argsort(-strength, kind="stable")[:max_poses])
        i, j, rotation = i[chosen], j[chosen], rotation[chosen]
    poses = np.tile(np.eye(4), (len(i), 1, 1))
    poses[:, :3, :3] = rotation
    # The corner of b goes onto the corner of a: with the rotation, one pair fixes the whole pose.
    poses[:, :3, 3] = np.asarray(a.position)[i] - np.einsum("kij,kj->ki", rotation, np.asarray(b.position)[j])
    is_observed = np.asarray(a.is_observed)[i] & np.asarray(b.is_observed)[j]
    return CornerPoses(poses.astype(np.float32), is_observed)


def _face_angles(normals: np.ndarray) -> np.ndarray:
    """Angles (n, 3) [rad] between faces 0-1, 1-2 and 2-0."""
    cosine = np.einsum("nki,nki->nk", normals, np.roll(normals, -1, axis=1))
    # Rounding may carry a cosine past 1, whose arc cosine is NaN.
    return np.arccos(np.clip(cosine, -1.0, 1.0))


class SubgraphPoses(NamedTuple):
    """Candidate poses from maximum common subgraphs.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`, one for each tied largest set.
        num_associations: Candidate associations searched.
        clique_size: Size of the largest set.
        completed: Whether the search ended inside its budget.
    """

    poses: Float[np.ndarray, "k 4 4"]
    num_associations: int
    clique_size: int
    completed: bool


def subgraph_poses(
    a: Corners,
    b: Corners,
    *,
    distance_tolerance: float,
    max_corners: int = SourceConfig.max_corners,
    settings: SubgraphConfig | None = None,
) -> SubgraphPoses:
    """Poses of the largest sets of corners whose distances and frames all agree (sections IV.B-C).

    Args:
        a: Corners of a.
        b: Corners of b.
        distance_tolerance: D of equation (4) [m].
        max_corners: The strongest so many of each map take part.
        settings: How the sets are searched; None for the defaults.
    """
    chosen = SubgraphConfig() if settings is None else settings
    a, b = strongest(a, max_corners), strongest(b, max_corners)
    kind_a, kind_b = np.asarray(a.convexity)[:, None], np.asarray(b.convexity)[None, :]
    is_alike = (kind_a == kind_b) | (kind_a == KIND_UNKNOWN) | (kind_b == KIND_UNKNOWN)
    candidates = np.argwhere(is_alike).astype(np.int32)
    # Fewer than three associations fix no transform.
    if len(candidates) < 3:
        return SubgraphPoses(np.zeros((0, 4, 4), np.float32), len(candidates), 0, True)
    common = maximum_common_subgraph(
        a,
        b,
        distance_tolerance=distance_tolerance,
        angle_tolerance=float(np.radians(chosen.angle_tolerance)),
        # The bound is in tolerances: distances of about the tolerance agree with each other whatever they are.
        min_distance=chosen.min_distance * distance_tolerance,
        associations=candidates,
        max_ties=chosen.max_ties,
        max_nodes=chosen.max_nodes,
    )
    position_a, position_b = np.asarray(a.position), np.asarray(b.position)
    poses = []
    if len(common) >= 3:
        # Ties of any size get one length and share one compiled alignment; rows of weight 0 do not count.
        size = max(max_corners, len(common))
        for tie in common.ties:
            pairs, weight = np.zeros((size, 2), np.int32), np.zeros(size, np.float32)
            pairs[: len(tie)], weight[: len(tie)] = tie, 1.0
            poses.append(np.asarray(align_points(position_a[pairs[:, 0]], position_b[pairs[:, 1]], weight)))
    stacked = np.stack(poses) if poses else np.zeros((0, 4, 4), np.float32)
    return SubgraphPoses(stacked, len(candidates), len(common), common.completed)


def strongest(corners: Corners, count: int) -> Corners:
    """The `count` corners of largest weight, observed ones first, on the host."""
    corners = corners.trimmed()
    # The last key counts first: observed corners are precise, virtual ones only many.
    order = np.lexsort((-np.asarray(corners.weight), ~np.asarray(corners.is_observed)))[:count]
    rows = (
        corners.position,
        corners.normals,
        corners.weight,
        corners.convexity,
        corners.mask,
        corners.is_observed,
    )
    return Corners(*(np.asarray(part)[order] for part in rows), num_found=corners.num_found)
