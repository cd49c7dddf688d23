"""The poses that a pair can have, by what the caller knows beforehand."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .distinct import least_trace


class PoseRange(NamedTuple):
    """The poses that a pair can have.

    Attributes:
        centroid: Centroid of map b [m], float32 (3,).
        max_lean: Largest angle by which a pose may tilt the vertical [deg]; None where it may tilt it at will.
        guess: A pose (4, 4) that the others must be near to; None where any pose may be.
        metres: Largest distance between where a pose and the guess put the centroid [m].
        radians: Largest angle between a pose and the guess [rad].
    """

    centroid: Float[np.ndarray, "3"]
    max_lean: float | None = None
    guess: Float[np.ndarray, "4 4"] | None = None
    metres: float = np.inf
    radians: float = np.inf

    def admits(self, poses: Float[np.ndarray, "k 4 4"]) -> Bool[np.ndarray, "k"]:
        """Whether each pose is upright, where it must be, and near the guess."""
        is_admitted = np.ones(len(poses), bool)
        if self.max_lean is not None:
            # The last entry of a rotation is the cosine of the angle between both vertical axes.
            is_admitted &= poses[:, 2, 2] > np.cos(np.radians(self.max_lean))
        if self.guess is not None:
            # Poses are compared where map b is: far from the origin of its frame a small turn is a long way.
            change = poses - self.guess[None]
            offset = change[:, :3, :3] @ self.centroid + change[:, :3, 3]
            trace = np.einsum("kij,ij->k", poses[:, :3, :3], self.guess[:3, :3])
            is_admitted &= np.linalg.norm(offset, axis=1) <= self.metres
            # Every rotation is within 180 degrees of the guess; of larger angles the cosine would rise again.
            is_admitted &= trace >= least_trace(np.degrees(min(self.radians, np.pi)))
        return is_admitted
