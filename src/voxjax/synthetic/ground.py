"""Rolling ground: a height over every place, and the rays that meet it."""

import numpy as np
from scipy.ndimage import map_coordinates


class Ground:
    """Height of the ground over a square: noise whose amplitude falls with the frequency, as hills and ditches do.

    Outside of the square the height is that of its nearest edge.
    """

    def __init__(self, rng: np.random.Generator, side: float, relief: float) -> None:
        """Draw it on a lattice of two metres, the first corner at (0, 0).

        Args:
            rng: What is drawn from.
            side: Side of the square [m].
            relief: Standard deviation of the height [m].
        """
        self._step = 2.0
        count = int(np.ceil(side / self._step)) + 2
        frequency = np.hypot(np.fft.fftfreq(count)[:, None], np.fft.rfftfreq(count)[None, :])
        frequency[0, 0] = np.inf
        wave = rng.normal(size=(count, count))
        self._height = np.fft.irfft2(np.fft.rfft2(wave) * frequency**-2.0, s=(count, count))
        self._height *= relief / self._height.std()

    def at(self, places: np.ndarray) -> np.ndarray:
        """Height [m] at places (n, 2) [m]."""
        return map_coordinates(self._height, (places / self._step).T, order=1, mode="nearest")

    def ranges(self, origin: np.ndarray, directions: np.ndarray, max_range: float) -> np.ndarray:
        """Distances (n,) [m] from one origin above the ground to it along unit vectors, inf beyond `max_range`."""
        # Steps of half a lattice cell miss no hill, and between two of them the ground is all but straight.
        marks = np.arange(0.0, max_range + self._step, 0.5 * self._step)
        found = np.full(len(directions), np.inf)
        # Rays that rise above all that lies around meet nothing.
        around = origin[:2] + max_range * np.asarray([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]])
        low, high = around.min(axis=0), around.max(axis=0)
        cells = [np.arange(a, b + self._step, self._step) for a, b in zip(low, high, strict=True)]
        top = self.at(np.stack(np.meshgrid(*cells), axis=-1).reshape(-1, 2)).max()
        rays = np.flatnonzero((directions[:, 2] <= 0) | (origin[2] < top))
        places = origin + marks[None, :, None] * directions[rays, None, :]
        gap = places[..., 2] - self.at(places[..., :2].reshape(-1, 2)).reshape(places.shape[:2])
        is_met = gap < 0
        after = is_met.argmax(axis=1)
        is_hit = is_met.any(axis=1) & (after > 0)
        rows, after = np.flatnonzero(is_hit), after[is_hit]
        start, end, shots = marks[after - 1], marks[after], directions[rays[rows]]
        # Halved seven times, a step of a metre leaves less than a centimetre.
        for _ in range(7):
            middle = 0.5 * (start + end)
            places = origin + middle[:, None] * shots
            is_above = places[:, 2] > self.at(places[:, :2])
            start, end = np.where(is_above, middle, start), np.where(is_above, end, middle)
        found[rays[rows]] = 0.5 * (start + end)
        return np.where(found <= max_range, found, np.inf)
