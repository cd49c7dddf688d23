"""Evidence of poses: what the voxels of both maps say for each pose, and against it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ... import rigid
from ..._runtime.placement import to_device
from ..._types import Array
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.exact import exact_information
from ...ops.evidence.scoring import surface_evidence
from ..hypotheses.settings import EvidenceConfig


class Judgement(NamedTuple):
    """Evidence of some poses; shares of the leverage of a map, mean of both ways.

    Attributes:
        hits: (k,) on a surface, facing the same way.
        conflicts: (k,) in clear free space.
        opposed: (k,) on a surface whose free side faces the other way.
        information: (k, 3, 3) what the hits fix, in frame a: 1/3 of the identity when everything agrees.
        changed: (k,) share of what is no wall, floor or ceiling that contradicts in whole pieces
            (`contradictions`); 0 where nobody looked.
        moved: (k,) surface in these pieces, of both maps [m^2]; 0 where nobody looked.
        pieces: (k,) surface in all conflicts that hang together, of both maps [m^2]; 0 where nobody looked.
        shared: (k,) surface that agrees, of both maps [m^2]; 0 where nobody looked.
        exact: (k,) agreement along the worst direction of planes that lie on each other to half a voxel: 1 when all
            surfaces of both maps do; 0 where nobody looked.
        exact_hits: (k,) share of both maps on such planes; 0 where nobody looked.
        conflict_weight: How many hits a conflict outweighs.
        has_free_space: Whether both maps know free space.
    """

    hits: np.ndarray
    conflicts: np.ndarray
    opposed: np.ndarray
    information: np.ndarray
    changed: np.ndarray
    moved: np.ndarray
    pieces: np.ndarray
    shared: np.ndarray
    exact: np.ndarray
    exact_hits: np.ndarray
    conflict_weight: float = EvidenceConfig.conflict_weight
    has_free_space: bool = True

    def score(self) -> np.ndarray:
        """Hits minus weighted conflicts (k,), at most 1."""
        return self.hits - self.conflict_weight * self.conflicts

    def strength(self) -> np.ndarray:
        """What poses are compared by (k,), at most 1.

        With free space, wrong poses set surface into it and lose their score. Without, most of a map may come near
        something of the other by chance, but not lie on it: the score counts as far as planes lie on each other along
        all directions, and by the square of their share in what agrees at all.
        """
        if self.has_free_space:
            return self.score()
        exactness = np.minimum(self.exact_hits / np.maximum(self.hits, 1e-9), 1.0)
        return self.score() * self.exact * exactness**2

    def take(self, rows: np.ndarray) -> "Judgement":
        """The evidence of some of the poses."""
        return Judgement._make([*(part[rows] for part in self[:-2]), *self[-2:]])

    def joined(self, other: "Judgement") -> "Judgement":
        """The evidence of these poses and then of others, of the same maps and with the same weight."""
        pairs = zip(self[:-2], other[:-2], strict=True)
        return Judgement._make([*map(np.concatenate, pairs), *self[-2:]])


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
    has_free_space = a.has_free_space and b.has_free_space
    is_signed = to_device(np.bool_(has_free_space))
    of_b, fixed_b = _one_way(a, b, T, is_signed, num_points, is_coarse=is_coarse)
    of_a, fixed_a = _one_way(b, a, np.asarray(rigid.inverse(T)), is_signed, num_points, is_coarse=is_coarse)
    # What the hits of a fix is known in frame b; it is turned into frame a under each pose.
    rotation = T[:, :3, :3].astype(np.float64)
    fixed_a = np.einsum("kij,kjl,kml->kim", rotation, fixed_a, rotation)
    # Maps count alike, whatever their sizes: each share is of the leverage of its own map.
    mean = (of_b + of_a) / 2
    nobody_looked = np.zeros(len(poses))
    lying = np.zeros((len(poses), 3, 3)) if is_coarse else _exact_agreement(a, b, T, is_signed, num_points)
    return Judgement(
        hits=mean[:, 0],
        conflicts=mean[:, 1],
        opposed=mean[:, 3],
        information=(fixed_b + fixed_a) / 2,
        changed=nobody_looked,
        moved=nobody_looked,
        pieces=nobody_looked,
        shared=nobody_looked,
        exact=along_worst_direction(lying),
        exact_hits=np.trace(lying, axis1=1, axis2=2),
        conflict_weight=conflict_weight,
        has_free_space=has_free_space,
    )


def no_judgement(conflict_weight: float, *, has_free_space: bool) -> Judgement:
    """Evidence of no pose at all."""
    nothing = np.zeros(0)
    return Judgement(
        hits=nothing,
        conflicts=nothing,
        opposed=nothing,
        information=np.zeros((0, 3, 3)),
        changed=nothing,
        moved=nothing,
        pieces=nothing,
        shared=nothing,
        exact=nothing,
        exact_hits=nothing,
        conflict_weight=conflict_weight,
        has_free_space=has_free_space,
    )


def along_worst_direction(information: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k"]:
    """Agreement along the direction that the hits fix least (k,): 1 when all surfaces of both maps agree."""
    # Where everything agrees the information is a third of the identity, whose least eigenvalue is 1/3.
    return 3.0 * np.linalg.eigvalsh(information)[:, 0]


def _exact_agreement(
    a: PreparedMap, b: PreparedMap, poses: np.ndarray, is_signed: Array, num_points: int | None
) -> Float[np.ndarray, "k 3 3"]:
    """What planes that lie on each other fix, in frame a; mean of both ways.

    Args:
        a: First map.
        b: Second map.
        poses: `T_a_b` candidates, float32 (k, 4, 4).
        is_signed: Whether the sides of surfaces mean something in both maps.
        num_points: Voxels of each map to look at, at most 8192.
    """
    # Few voxels tell as well as all of them how much agrees along a direction: they are drawn by leverage.
    count = min(num_points or 8192, 8192)
    of_b = _exact_one_way(a, b, poses, is_signed, count)
    of_a = _exact_one_way(b, a, np.asarray(rigid.inverse(poses)), is_signed, count)
    rotation = poses[:, :3, :3].astype(np.float64)
    return (of_b + np.einsum("kij,kjl,kml->kim", rotation, of_a, rotation)) / 2


def _exact_one_way(
    target: PreparedMap, other: PreparedMap, poses: np.ndarray, is_signed: Array, num_points: int
) -> np.ndarray:
    """What the planes of `other` that lie on those of `target` fix (k, 3, 3), under poses of it in the target."""
    rows = sample_rows(other, num_points)
    # Half a voxel: what is left of the grid's rounding in the planes, and of the noise of good sensors.
    reach = np.float32(0.5 * target.grid.voxel_size)
    fixed = exact_information(
        target.codes,
        target.keys,
        target.block,
        target.anchors,
        target.sides,
        np.asarray(other.anchors)[rows],
        np.asarray(other.sides)[rows],
        np.full(num_points, 1.0 / num_points, np.float32),
        poses,
        is_signed,
        reach=to_device(reach),
    )
    return np.asarray(fixed, np.float64)


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
