"""What a merge gives: the fused map, the poses, and how well the pairs agree with each other."""

from collections import Counter
from typing import Literal

import equinox as eqx
import numpy as np

from ..grid import VoxelGrid
from ..registration.hypotheses.map_features import LateFeatures
from ..registration.types import Registration

Status = Literal["merged", "partial", "no_overlap"]


class LoopError(eqx.Module):
    """How far an accepted pair that the tree did not need disagrees with the poses of the tree.

    Attributes:
        a: Number of the first map.
        b: Number of the second map.
        metres: Distance between the two places of map b's centre [m].
        radians: Angle between the two rotations [rad].
    """

    a: int
    b: int
    metres: float
    radians: float


class Merge(eqx.Module):
    """Outcome of `voxjax.merge`.

    Attributes:
        grid: The fused map in the world frame; None when no two maps fit together.
        poses: Pose `T_world_map` (4, 4) float64 of each map, or None for a map that fits none. World is the
            frame of the first map that was merged.
        pairs: (a, b, registration) for each pair that was tried, a < b.
        status: "merged" all maps, "partial" some of them, "no_overlap" none.
        loops: Disagreement of the accepted pairs outside the tree; empty with two maps.
        seconds: {stage: s}: "features", "register", "fuse" and their sum "total".
        late: Corners and descriptors of each map, computed when first asked for; None for a map without any, or where
            the preset computes its own.
        middles: Middle of each map in its own frame [m], without strays far away where the preset leaves them aside.
    """

    grid: VoxelGrid | None
    poses: tuple[np.ndarray | None, ...]
    pairs: tuple[tuple[int, int, Registration], ...]
    status: Status
    loops: tuple[LoopError, ...]
    seconds: dict
    late: tuple[LateFeatures | None, ...]
    middles: tuple[np.ndarray, ...]

    def __repr__(self) -> str:
        """One line: status, verdicts of the pairs, the fused map, and the reason."""
        verdicts = Counter(registration.verdict for _, _, registration in self.pairs)
        pairs = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        return f"Merge({self.status}, pairs: {pairs or 'none'}, grid={self.grid!r}: {self.reason})"

    @property
    def reason(self) -> str:
        """One sentence for a person: what was merged, what was left out and why."""
        left_out = [number for number, pose in enumerate(self.poses) if pose is None]
        if self.status == "merged":
            return f"All {len(self.poses)} maps were merged."
        if self.status == "partial":
            names = ", ".join(map(str, left_out))
            return (
                f"{len(self.poses) - len(left_out)} of {len(self.poses)} maps were merged; left out: {names}."
            )
        # Why the closest pair failed tells a person more than that all of them did.
        return "No two maps fit together." if self.closest is None else self.closest[2].reason

    @property
    def closest(self) -> tuple[int, int, Registration] | None:
        """The pair with the highest confidence, then the best evidence; None where no pair was tried."""
        return max(self.pairs, key=lambda pair: (pair[2].confidence, pair[2].best_score), default=None)
