"""Verdicts on pairs of all families of places: rows for `bench calibration --families`, its table, and the fit.

A pose is right within 3 degrees and 0.4 m, or three of the coarser map's voxels. Pairs of one place are reported by
their overlap; the others, with moved things, of other places, mirrored, scaled and of other storeys, by what they are.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.families import FAMILIES, family_pair, roles_of
from bench.reliability import calibration_error, upper_bound
from bench.reports import markdown_table
from voxjax import register
from voxjax.metrics import pose_error
from voxjax.registration.judging.settings import VerdictConfig


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
    """`count` pairs of each role of each family, with free space and without; families take turns.

    Args:
        count: Pairs of each role; four seeds in a row have all ranges of overlap.
        first_seed: Other seeds share no map.
    """
    for seed in range(first_seed, first_seed + count):
        for family in FAMILIES:
            for role in roles_of(family):
                yield Job(family, role, seed, has_free_space=True)
                yield Job(family, role, seed, has_free_space=False)


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


def family_table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines for people and for Markdown: verdicts by family and role, with bounds and calibration errors."""
    head = ("family", "pairs of one place, overlap", "right", "accepted of the right", "accepted and wrong")
    lines = []
    for known in (True, False):
        mine = [row for row in rows if row["name"].endswith("_cloud") != known]
        if not mine:
            continue
        table = []
        for family in sorted({row["kind"] for row in mine}):
            for low, high in ((0.05, 0.1), (0.1, 0.2), (0.2, 1.0)):
                same = [
                    row
                    for row in mine
                    if row["kind"] == family and row["role"] == "same" and low <= row["overlap"] < high
                ]
                table.append((family, f"{len(same)}, {low:g} to {high:g}", *_counts(same)))
        lines += ["", "With free space:" if known else "Clouds, without free space:", ""]
        lines += [markdown_table(head, table), "", *_other_roles(mine)]
        errors = [
            f"{family} {calibration_error(*_confidences([row for row in mine if row['kind'] == family])):.3f}"
            for family in sorted({row["kind"] for row in mine})
        ]
        lines += ["", f"expected calibration error: {', '.join(errors)}"]
    return lines


def _counts(rows: list[dict[str, Any]]) -> tuple[str, str, str]:
    right = [row for row in rows if row["right"]]
    accepted = [row for row in rows if row["verdict"] == "accepted"]
    wrong = sum(not row["right"] for row in accepted)
    return str(len(right)), f"{len(accepted) - wrong} / {len(right)}", str(wrong)


def _other_roles(rows: list[dict[str, Any]]) -> list[str]:
    """A table of the pairs that are not two maps of one place as it was."""
    table = []
    for role in ("changed", "elsewhere", "mirrored", "scaled", "storey"):
        mine = [row for row in rows if row["role"] == role]
        accepted = [row for row in mine if row["verdict"] == "accepted"]
        wrong = sum(not row["right"] for row in accepted)
        named = sum(_is_named(row) for row in mine)
        bound = f"{wrong} ({100 * upper_bound(wrong, max(len(mine), 1)):.1f} %)"
        table.append((role, str(len(mine)), str(len(accepted) - wrong), bound, str(named)))
    head = ("pairs", "number", "accepted and right", "accepted and wrong (95 % bound)", "cause named")
    return [markdown_table(head, table)]


def _is_named(row: dict[str, Any]) -> bool:
    """Whether the reason names what is wrong."""
    words = {"mirrored": "mirrored", "scaled": "to be larger", "storey": "storey", "changed": "moved"}
    alternatives = {"scaled": ("to be larger", "to be smaller")}
    wanted = alternatives.get(row["role"], (words.get(row["role"], "\0"),))
    return any(word in row["reason"] for word in wanted)


def _confidences(rows: list[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray([row["confidence"] for row in rows]), np.asarray([row["right"] for row in rows], float)
