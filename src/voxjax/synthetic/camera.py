"""A depth camera: a narrow field of view, short ranges, noise that grows with the square of the range."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DepthCamera:
    """A pinhole camera that measures depth, as RGB-D cameras do; it looks along x, z is up.

    Attributes:
        field_of_view: Full angles across and upright [degrees].
        num_pixels: Pixels across and upright.
        max_range: Longest distance that is measured [m].
        free_range: A pixel without echo is taken as free space up to here [m]; such cameras tell nothing by it.
        range_noise: Standard deviation of the range at one metre [m].
        dropout: Share of the pixels that are lost.
        people: Mean number of people near the sensor in a picture.
    """

    field_of_view: tuple[float, float] = (58.0, 45.0)
    num_pixels: tuple[int, int] = (84, 64)
    max_range: float = 4.0
    free_range: float = 0.0
    range_noise: float = 0.003
    dropout: float = 0.05
    people: float = 0.0

    def directions(self) -> np.ndarray:
        """Unit vectors (n, 3) in the sensor's frame: x ahead, z up."""
        # Pixels lie evenly on a plane before the camera.
        reach = np.tan(0.5 * np.radians(self.field_of_view))
        across, upright = (np.linspace(-r, r, n) for r, n in zip(reach, self.num_pixels, strict=True))
        y, z = (plane.reshape(-1) for plane in np.meshgrid(across, upright, indexing="ij"))
        rays = np.stack([np.ones_like(y), y, z], axis=-1)
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def noise_at(self, ranges: np.ndarray) -> np.ndarray:
        """Standard deviation of each range (n,) [m]."""
        return self.range_noise * np.minimum(ranges, self.max_range) ** 2
