"""Evidence of poses: what the voxels of both maps say for each pose, and against it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ... import rigid
from ..._runtime.placement import to_device
from ..._types import Array
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.scoring import surface_evidence
from ..hypotheses.settings import EvidenceConfig


class Judgement(NamedTuple):
    """Evidence of some poses; shares of the leverage of a map, mean of both ways.

    Attributes:
        hits: (k,) on a surface, facing the same way.
        conflicts: (k,) in clear free space.
        opposed: (k,) on a surface whose free side faces the other way.
        information: (k, 3, 3) what the hits fix, in frame a: 1/3 of the identity when everything agrees.
        pieces: (k,) surface in conflicts that hang together, of both maps [m^2]; 0 where nobody looked
            (`conflict_pieces`).
        shared: (k,) surface that agrees, of both maps [m^2]; 0 where nobody looked.
        conflict_weight: How many hits a conflict outweighs.
    """

    hits: np.ndarray
    conflicts: np.ndarray
    opposed: np.ndarray
    information: np.ndarray
    pieces: np.ndarray
    shared: np.ndarray
    conflict_weight: float = EvidenceConfig.conflict_weight

    def score(self) -> np.ndarray:
        """Hits minus weighted conflicts (k,), at most 1."""
        return self.hits - self.conflict_weight * self.conflicts

    def take(self, rows: np.ndarray) -> "Judgement":
        """The evidence of some of the poses."""
        return Judgement._make([*(part[rows] for part in self[:-1]), self.conflict_weight])

    def joined(self, other: "Judgement") -> "Judgement":
        """The evidence of these poses and then of others, judged with the same weight."""
        pairs = zip(self[:-1], other[:-1], strict=True)
        return Judgement._make([*map(np.concatenate, pairs), self.conflict_weight])


def judge_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int | None,
    conflict_weight: float = EvidenceConfig.conflict_weight,
    is_coarse: bool = False,
) -> Judgement:
    """Evidence of poses, both ways.

    Args:
        a: First map.
        b: Second map.
        poses: `T_a_b` candidates.
        num_points: Voxels of each map to look at; None for all of them.
        conflict_weight: How many hits a conflict outweighs.
        is_coarse: Judge at the tolerance of unrefined poses.
    """
    T = poses.astype(np.float32)
    is_signed = to_device(np.bool_(a.has_free_space and b.has_free_space))
    of_b, fixed_b = _one_way(a, b, T, is_signed, num_points, is_coarse=is_coarse)
    of_a, fixed_a = _one_way(b, a, np.asarray(rigid.inverse(T)), is_signed, num_points, is_coarse=is_coarse)
    # What the hits of a fix is known in frame b; it is turned into frame a under each pose.
    rotation = T[:, :3, :3].astype(np.float64)
    fixed_a = np.einsum("kij,kjl,kml->kim", rotation, fixed_a, rotation)
    # Maps count alike, whatever their sizes: each share is of the leverage of its own map.
    mean = (of_b + of_a) / 2
    nobody_looked = np.zeros(len(poses))
    return Judgement(
        hits=mean[:, 0],
        conflicts=mean[:, 1],
        opposed=mean[:, 3],
        information=(fixed_b + fixed_a) / 2,
        pieces=nobody_looked,
        shared=nobody_looked,
        conflict_weight=conflict_weight,
    )


def no_judgement(conflict_weight: float) -> Judgement:
    """Evidence of no pose at all."""
    nothing = np.zeros(0)
    return Judgement(nothing, nothing, nothing, np.zeros((0, 3, 3)), nothing, nothing, conflict_weight)


def _one_way(
    target: PreparedMap,
    other: PreparedMap,
    poses: np.ndarray,
    is_signed: Array,
    num_points: int | None,
    *,
    is_coarse: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (k, 4) of the leverage of one map, and what its hits fix (k, 3, 3), under poses of it in the other.

    Args:
        target: The map that is looked into.
        other: The map whose voxels look.
        poses: Poses (k, 4, 4) of `other` in `target`.
        is_signed: Whether the sides of surfaces mean something in both maps.
        num_points: Voxels to look at; None for all of them.
        is_coarse: Judge at the tolerance of unrefined poses.
    """
    # Cut on the host: each new shape of a map would compile a lookup here.
    points, sides, weights = (
        np.asarray(rows)[: other.num_points] for rows in (other.points, other.sides, other.weights)
    )
    if num_points is not None:
        rows = sample_rows(other, num_points)
        points, sides = points[rows], sides[rows]
        # Points are drawn by leverage, and therefore all count the same.
        weights = np.full(num_points, 1.0 / num_points, np.float32)
    # Before refinement a right pose is off by about a coarse cell, and would seem to conflict with surfaces
    # that it fits.
    codes = target.coarse_codes() if is_coarse else target.codes
    shares, fixed = surface_evidence(
        codes, target.keys, target.block, target.sides, points, sides, weights, poses, is_signed
    )
    return np.asarray(shares, np.float64), np.asarray(fixed, np.float64)
