"""From many hypotheses to a few distinct, refined leaders, judged by all voxels of both maps."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ... import rigid
from ..._runtime.placement import to_device
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.align import align_poses
from ...ops.evidence.scoring import surface_evidence
from ..hypotheses.proposals import Proposals
from ..hypotheses.ranking import COARSE_CONFLICT_WEIGHT, distinct_poses, rank_poses
from .settings import LeaderConfig

CONFLICT_WEIGHT = 6.0
"""How many hits a conflict outweighs; anything from 3 to 10 served in trials."""

DISTINCT_VOXELS, DISTINCT_DEGREES = 5.0, 8.0
"""Refined poses nearer to each other than both are one: with 4 degrees, poses on their way to the best one of a coarse
map stood beside it as rivals."""


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
    """

    hits: np.ndarray
    conflicts: np.ndarray
    opposed: np.ndarray
    information: np.ndarray
    pieces: np.ndarray
    shared: np.ndarray

    def score(self, conflict_weight: float = CONFLICT_WEIGHT) -> np.ndarray:
        """Hits minus weighted conflicts, at most 1."""
        return self.hits - conflict_weight * self.conflicts

    def take(self, rows: np.ndarray) -> "Judgement":
        """The evidence of some of the poses."""
        return Judgement(*(part[rows] for part in self))


def judge_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int | None,
    is_coarse: bool = False,
) -> Judgement:
    """Evidence of poses, both ways.

    Args:
        a: First map.
        b: Second map.
        poses: `T_a_b` candidates.
        num_points: Voxels of each map to look at; None for all of them.
        is_coarse: Judge at the tolerance of unrefined poses.
    """
    T = poses.astype(np.float32)
    is_signed = to_device(np.bool_(a.has_free_space and b.has_free_space))
    sums, information = [], []
    for target, other, direction in ((a, b, T), (b, a, rigid.inverse(T))):
        # On the host: each new shape of a map would compile a lookup here.
        points, sides, weights = (
            np.asarray(a)[: other.num_points] for a in (other.points, other.sides, other.weights)
        )
        if num_points is not None:
            rows = sample_rows(other, num_points)
            points, sides = points[rows], sides[rows]
            weights = np.full(num_points, 1.0 / num_points, np.float32)
        codes = target.coarse_codes(target.coarse_factor) if is_coarse else target.codes
        shares, fixed = surface_evidence(
            codes, target.keys, *target.block, target.sides, points, sides, weights, direction, is_signed,
        )  # fmt: skip
        sums.append(np.asarray(shares, np.float64))
        information.append(np.asarray(fixed, np.float64))
    rotation = T[:, :3, :3].astype(np.float64)
    information[1] = np.einsum("kij,kjl,kml->kim", rotation, information[1], rotation)
    mean = (sums[0] + sums[1]) / 2
    nobody_looked = np.zeros(len(poses))
    return Judgement(
        mean[:, 0],
        mean[:, 1],
        mean[:, 3],
        (information[0] + information[1]) / 2,
        nobody_looked,
        nobody_looked,
    )


def refine_poses(
    a: PreparedMap,
    b: PreparedMap,
    poses: Float[np.ndarray, "k 4 4"],
    *,
    num_points: int,
    num_steps: int,
    start_distance: float = 5.0,
    final_distance: float = 1.5,
) -> Float[np.ndarray, "k 4 4"]:
    """Align each pose, b onto the surface of a; distances are robust scales [voxel]."""
    rows = sample_rows(b, num_points)
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    points = np.asarray(b.points)[rows]
    scales = to_device((np.float32(start_distance), np.float32(final_distance)))
    refined = align_poses(
        a.keys, *a.block, a.points, a.normals, points, weights, poses.astype(np.float32),
        num_steps=num_steps,
        start_distance=scales[0], final_distance=scales[1],
    )  # fmt: skip
    return np.asarray(refined)


class Leaders(NamedTuple):
    """Distinct refined poses, best first.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`.
        judgement: Evidence over all voxels.
        sources: Name of the source of each pose.
    """

    poses: np.ndarray
    judgement: Judgement
    sources: tuple[str, ...]

    def take(self, rows: np.ndarray) -> "Leaders":
        """Some of the leaders, in the order given."""
        return Leaders(self.poses[rows], self.judgement.take(rows), tuple(self.sources[row] for row in rows))


def find_leaders(
    a: PreparedMap,
    b: PreparedMap,
    proposals: Proposals,
    settings: LeaderConfig,
) -> Leaders:
    """Rank proposals, refine the better ones, and rank again; no leader where nothing was proposed.

    Unrefined poses are judged at a coarse tolerance, because ranking them as if they were final loses right ones.
    """
    poses, sources = proposals.poses, proposals.sources
    if len(poses) == 0:
        nothing = np.zeros(0)
        judgement = Judgement(nothing, nothing, nothing, np.zeros((0, 3, 3)), nothing, nothing)
        return Leaders(poses, judgement, ())
    voxel = a.grid.voxel_size
    centroid = np.asarray(b.centroid, np.float64)

    def best(poses: np.ndarray, scores: np.ndarray, voxels: float, degrees: float, count: int) -> np.ndarray:
        return distinct_poses(
            poses, scores, centroid, metres=voxels * voxel, degrees=degrees, max_count=count
        )

    rows = best(poses, rank_poses(a, b, poses), 2.0, 1.5, settings.num_ranked)
    coarse = judge_poses(a, b, poses[rows], num_points=1024, is_coarse=True)
    rows = rows[best(poses[rows], coarse.score(COARSE_CONFLICT_WEIGHT), 2.0, 1.5, settings.num_refined)]
    refined = refine_poses(a, b, poses[rows], num_points=1024, num_steps=15)
    kept = best(
        refined,
        judge_poses(a, b, refined, num_points=4096).score(),
        DISTINCT_VOXELS,
        DISTINCT_DEGREES,
        settings.num_leaders,
    )
    rows, refined = rows[kept], refined[kept]
    refined = refine_poses(
        a, b, refined, num_points=8192, num_steps=12, start_distance=2.5, final_distance=1.0
    )
    judgement = judge_poses(a, b, refined, num_points=None)
    kept = best(refined, judgement.score(), DISTINCT_VOXELS, DISTINCT_DEGREES, settings.num_leaders)
    return Leaders(refined, judgement, tuple(sources[row] for row in rows)).take(kept)


def merge_leaders(
    a: PreparedMap, b: PreparedMap, first: Leaders, second: Leaders, settings: LeaderConfig
) -> Leaders:
    """The best distinct poses of two sets of leaders."""
    both = Leaders(
        np.concatenate([first.poses, second.poses]),
        Judgement(*map(np.concatenate, zip(first.judgement, second.judgement, strict=True))),
        (*first.sources, *second.sources),
    )
    chosen = distinct_poses(
        both.poses,
        both.judgement.score(),
        np.asarray(b.centroid, np.float64),
        metres=DISTINCT_VOXELS * a.grid.voxel_size,
        degrees=DISTINCT_DEGREES,
        max_count=settings.num_leaders,
    )
    return both.take(chosen)
