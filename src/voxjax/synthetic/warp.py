"""Smooth bending of a world, by which surfaces of straight solids become uneven and nothing repeats to the voxel."""

from typing import NamedTuple

import numpy as np


class Warp(NamedTuple):
    """A sum of plane waves that moves every point of the world, the same for all who look at it.

    Attributes:
        waves: (n, 3) wave vectors [rad/m].
        phases: (n, 3) phases [rad], one for each axis along which points are moved.
        amplitudes: (n, 3) [m].
    """

    waves: np.ndarray
    phases: np.ndarray
    amplitudes: np.ndarray

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """How far points (n, 3) are moved, (n, 3) [m]."""
        angles = points @ self.waves.T
        moved = [
            np.sin(angles + self.phases[:, axis]) @ self.amplitudes[:, axis]
            for axis in range(points.shape[1])
        ]
        return np.stack(moved, axis=-1)


def draw_warp(
    rng: np.random.Generator,
    deviation: float | tuple[float, float, float],
    wavelengths: tuple[float, float],
    *,
    num_waves: int = 8,
) -> Warp:
    """Draw a warp.

    Args:
        rng: Source of chance.
        deviation: Standard deviation of the shift [m], one number or one for each axis.
        wavelengths: Shortest and longest wave [m].
        num_waves: Number of waves; their lengths are spread evenly on a logarithmic scale.
    """
    directions = rng.normal(size=(num_waves, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = np.geomspace(*wavelengths, num_waves) * rng.uniform(0.8, 1.25, num_waves)
    # Long waves carry more than short ones, as in uneven things of all kinds; the squares of sines are 1/2 in the mean.
    weights = np.sqrt(lengths) / np.linalg.norm(np.sqrt(lengths)) * np.sqrt(2.0)
    amplitudes = weights[:, None] * np.broadcast_to(np.asarray(deviation, np.float64), 3)
    phases = rng.uniform(0.0, 2.0 * np.pi, (num_waves, 3))
    return Warp(2.0 * np.pi / lengths[:, None] * directions, phases, amplitudes)
