"""Verdicts on pairs of all families of places: rows for `bench calibration --families` and for the fit.

A pose is right within 3 degrees and 0.4 m, or three of the coarser map's voxels.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.families import FAMILIES, family_pair, roles_of
from voxjax import register
from voxjax.metrics import pose_error
from voxjax.registration.judging.settings import VerdictConfig

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


def family_row(job: Job) -> dict[str, Any]:
    """Register a pair: the verdict, what it rests on, and the truth."""
    family, role, seed, has_free_space = job
    pair = family_pair(family, role, seed, has_free_space=has_free_space)
    found = register(pair.a, pair.b)
    metres = max(0.4, 3.0 * max(pair.a.voxel_size, pair.b.voxel_size))
    strengths = np.asarray([h.score for h in found.hypotheses])
    right = [False] * len(strengths)
    if pair.T_a_b is not None:
        errors = [pose_error(np.asarray(h.T_a_b), pair.T_a_b, pair.centroid_of_b) for h in found.hypotheses]
        right = [e.degrees <= 3.0 and e.metres <= metres for e in errors]
    return {
        "name": job.name,
        "kind": family,
        "role": role,
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


def _is_group_right(strengths: np.ndarray, right: list[bool]) -> bool:
    """Whether one of the poses that are about as strong as the best is right."""
    if len(strengths) == 0:
        return False
    return bool(np.asarray(right)[strengths >= VerdictConfig.min_rival_share * strengths.max()].any())
