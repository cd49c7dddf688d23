"""Verdicts on generated pairs of one building, equal rooms, and different buildings: rows for `bench calibration`."""

import itertools
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.calibration_worlds import load_world, seeds_of, without_free_space
from voxjax.metrics import pose_error
from voxjax.pipeline.config import Config
from voxjax.pipeline.features import features_at, working_voxel
from voxjax.pipeline.pair import register_features


def building_jobs(
    counts: tuple[int, int, int], first_seed: int, *, cache: Path | None, clouds: bool
) -> list[tuple[str, Callable[[], dict[str, Any]]]]:
    """Names of pairs, and functions that give their rows.

    Args:
        counts: Pairs of one building, pairs among equal rooms, and maps of different buildings, each against each.
        first_seed: Other seeds share no map.
        cache: Folder that keeps the generated maps, or None.
        clouds: Whether all free space is taken from the maps.
    """
    num_pairs, num_hotels, num_buildings = counts
    pairs: list[tuple[str, tuple[int, ...]]] = [
        (kind, (seed,))
        for kind, count in (("pair", num_pairs), ("hotel", num_hotels))
        for seed in seeds_of(kind, count, first_seed)
    ]
    pairs += [
        ("cross", two) for two in itertools.combinations(seeds_of("build", num_buildings, first_seed), 2)
    ]
    runner, end = Runner(cache, clouds=clouds), "_cloud" if clouds else ""
    return [
        (f"{kind}_{'_'.join(map(str, seeds))}{end}", partial(runner.row, kind, seeds))
        for kind, seeds in pairs
    ]


def judge(found: vx.Registration, truth: np.ndarray | None, b: vx.VoxelGrid) -> dict[str, Any]:
    """One row: the verdict, the evidence that it rests on, and the truth within 3 degrees and 0.4 m."""
    row: dict[str, Any] = {
        "verdict": found.verdict,
        "confidence": found.confidence,
        "right": False,
        "rank": None,
        "rounds": found.stats.get("num_rounds"),
        "proposed": found.stats.get("num_hypotheses"),
        "has_free_space": found.stats.get("has_free_space"),
        "seconds": sum(found.stats["seconds"].values()),
    }
    centroid = b.occupied_points().mean(axis=0, dtype=np.float64)
    errors = [None if truth is None else pose_error(h.T_a_b, truth, centroid) for h in found.hypotheses]
    good = [e is not None and e.degrees <= 3.0 and e.metres <= 0.4 for e in errors]
    row["leaders"] = [
        {
            "score": h.evidence.score,
            "support": h.evidence.support,
            "shared": h.evidence.shared_area,
            "contradiction": h.evidence.contradiction_area,
            "conflict": h.evidence.free_conflict,
            "right": is_right,
        }
        for h, is_right in zip(found.hypotheses, good, strict=True)
    ]
    row["rank"] = good.index(True) if True in good else None
    row["right"] = row["rank"] == 0
    if row["right"] and errors[0] is not None and truth is not None:
        T = np.asarray(found.T_a_b, np.float64)
        # In the order of the covariance: translation of map b's centroid, then rotation, both in frame a.
        turn = Rotation.from_matrix(truth[:3, :3] @ T[:3, :3].T).as_rotvec()
        shift = (truth - T)[:3] @ np.append(centroid, 1.0)
        row |= {"tangent": [*shift, *turn], "covariance": np.asarray(found.covariance).tolist()}
        row |= {"degrees": errors[0].degrees, "metres": errors[0].metres}
    return row


class Runner:
    """Loads and registers pairs; keeps the features of the buildings' single maps."""

    def __init__(self, cache: Path | None, *, clouds: bool) -> None:
        self.cache = cache
        self.clouds = clouds
        self.single: dict[int, Any] = {}

    def load(self, seed: int, kind: str) -> tuple[list[vx.VoxelGrid], np.ndarray | None]:
        """Maps and true pose of a seed."""
        grids, truth = load_world(seed, kind, self.cache)
        return [without_free_space(g) for g in grids] if self.clouds else grids, truth

    def row(self, kind: str, seeds: tuple[int, ...]) -> dict[str, Any]:
        """Register one pair."""
        return {"kind": kind} | self._judged(kind, seeds)

    def _judged(self, kind: str, seeds: tuple[int, ...]) -> dict[str, Any]:
        if kind == "cross":
            for seed in seeds:
                if seed not in self.single:
                    (grid,), _ = self.load(seed, "build")
                    self.single[seed] = grid, features_at(grid, voxel_size=grid.voxel_size)
            (_, fa), (b, fb) = (self.single[seed] for seed in seeds)
            return judge(register_features(fa, fb), None, b)
        (a, b), truth = self.load(seeds[0], kind)
        size = working_voxel([a, b], Config()).size
        fa, fb = features_at(a, voxel_size=size), features_at(b, voxel_size=size)
        return judge(register_features(fa, fb), truth, b)
