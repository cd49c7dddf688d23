"""Verdicts on pairs of all families of places: rows for `bench calibration --families` and for the fit.

A pose is right within 3 degrees and 0.4 m, or three of the coarser map's voxels.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.families import FAMILIES, FamilyPair, family_pair, roles_of
from bench.peers import Peer, run_peer
from voxjax import register
from voxjax.metrics import PoseError, pose_error
from voxjax.registration.judging.settings import VerdictConfig

Row = dict[str, Any]

NEGATIVES: tuple[str, ...] = ("elsewhere", "mirrored", "scaled", "storey")
"""Roles without a true pose."""


class Job(NamedTuple):
    """One pair to register.

    Attributes:
        family: Name of the family.
        role: What the pair is (`bench.families.ROLES`).
        seed: Its seed.
        has_free_space: Whether the maps know free space.
    """

    family: str
    role: str
    seed: int
    has_free_space: bool

    @property
    def name(self) -> str:
        """Unique name."""
        return f"{self.family}_{self.role}_{self.seed}{'' if self.has_free_space else '_cloud'}"


def family_jobs(count: int, first_seed: int) -> Iterator[Job]:
    """`count` pairs of each role of each family, with free space and without, seed by seed.

    The order within a seed is drawn from it, so that all parts of the list hold some of each.

    Args:
        count: Pairs of each role; four seeds in a row have all ranges of overlap.
        first_seed: Other seeds share no map.
    """
    for seed in range(first_seed, first_seed + count):
        jobs = [
            Job(family, role, seed, has_free_space=is_known)
            for family in FAMILIES
            for role in roles_of(family)
            for is_known in (True, False)
        ]
        for number in np.random.default_rng([seed, 11]).permutation(len(jobs)):
            yield jobs[number]


def family_row(job: Job, peers: Sequence[Peer] = (), earlier: Row | None = None) -> Row:
    """Register a pair: the verdict, what it rests on, the truth, and what peers say of the same maps.

    Args:
        job: The pair.
        peers: Other systems to ask; their answers are `row["peers"]`, by name.
        earlier: The row of an earlier run, to which answers of peers that it does not have are added; None to begin.
    """
    pair = family_pair(job.family, job.role, job.seed, has_free_space=job.has_free_space)
    row = _row(job, pair) if earlier is None else earlier
    missing = [peer for peer in peers if peer.name not in row.get("peers", {})]
    if missing:
        row = row | {"peers": row.get("peers", {}) | {peer.name: _answer(peer, pair) for peer in missing}}
    return row


def _row(job: Job, pair: FamilyPair) -> Row:
    """The row without peers."""
    found = register(pair.a, pair.b)
    strengths = np.asarray([h.score for h in found.hypotheses])
    right = [False] * len(strengths)
    if pair.T_a_b is not None:
        errors = [pose_error(np.asarray(h.T_a_b), pair.T_a_b, pair.centroid_of_b) for h in found.hypotheses]
        right = [_is_right(error, pair) for error in errors]
    return {
        "name": job.name,
        "kind": job.family,
        "role": job.role,
        "overlap": pair.overlap,
        "factor": pair.factor,
        "free_space": found.stats.get("free_space", "unknown"),
        "verdict": found.verdict,
        "confidence": found.confidence,
        "reason": found.reason,
        "right": bool(right and right[0]),
        "rank": right.index(True) if any(right) else None,
        "evidence": found.stats.get("verdict"),
        "is_group_right": _is_group_right(strengths, right),
        "seconds": sum(found.stats["seconds"].values()),
    }


def _answer(peer: Peer, pair: FamilyPair) -> Row:
    """A peer's own verdict (None where it has none), the truth, and its seconds with the refinement."""
    a, b = (grid.occupied_points() for grid in (pair.a, pair.b))
    # Rooms have voxels of 0.04 m: like real maps, they would be thinned to nothing at the 0.3 m of simulated buildings.
    found = run_peer(peer, a, b, voxel_size=max(pair.a.voxel_size, pair.b.voxel_size), is_real=True)
    answer: Row = {"valid": found.is_valid, "right": False, "seconds": found.seconds}
    if pair.T_a_b is not None:
        error = pose_error(found.T_a_b, pair.T_a_b, pair.centroid_of_b)
        answer |= {"right": _is_right(error, pair), "degrees": error.degrees, "metres": error.metres}
    return answer


def _is_right(error: PoseError, pair: FamilyPair) -> bool:
    """Whether a pose is right: within 3 degrees, and within 0.4 m or three of the wider voxels."""
    metres = max(0.4, 3.0 * max(pair.a.voxel_size, pair.b.voxel_size))
    return bool(error.degrees <= 3.0 and error.metres <= metres)


def _is_group_right(strengths: np.ndarray, right: list[bool]) -> bool:
    """Whether one of the poses that are about as strong as the best is right."""
    if len(strengths) == 0:
        return False
    return bool(np.asarray(right)[strengths >= VerdictConfig.min_rival_share * strengths.max()].any())
