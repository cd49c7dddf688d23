"""Colours of the pictures: heights, maps, and who saw what."""

import numpy as np
from jaxtyping import Float, UInt8

BACKGROUND = (255, 255, 255)
FREE_TINT = (233, 236, 240)
INK = (40, 44, 52)

MAP_COLORS = np.asarray(
    [(46, 117, 214), (238, 128, 36), (150, 80, 190), (214, 60, 90), (20, 160, 150), (140, 110, 60)], np.uint8
)
"""One colour a map, repeated when there are more maps."""

SHARED_COLOR = (84, 168, 92)
"""What two or more maps saw."""

_HEIGHT_STOPS = np.asarray(
    [(58, 66, 140), (48, 118, 178), (62, 170, 166), (146, 204, 120), (240, 214, 104), (246, 160, 84)],
    np.float64,
)


def map_color(index: int) -> tuple[int, int, int]:
    """Colour of the map with that number."""
    red, green, blue = (int(c) for c in MAP_COLORS[index % len(MAP_COLORS)])
    return red, green, blue


def height_share(height: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Heights scaled to [0, 1] between their 1st and 99th percentile, so that strays do not eat the range."""
    if not len(height):
        return height.astype(np.float64)
    low, high = np.percentile(height, (1.0, 99.0))
    return np.clip((height - low) / max(high - low, 1e-9), 0.0, 1.0)


def color_by_height(height: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours that rise from blue through green to orange."""
    place = height_share(height) * (len(_HEIGHT_STOPS) - 1)
    # The highest place belongs to the last interval, beyond whose end there is no stop.
    below = np.minimum(place.astype(np.int64), len(_HEIGHT_STOPS) - 2)
    share = (place - below)[:, None]
    return (_HEIGHT_STOPS[below] * (1.0 - share) + _HEIGHT_STOPS[below + 1] * share).astype(np.uint8)


def tint_by_height(
    base: UInt8[np.ndarray, "n 3"], height: Float[np.ndarray, " n"]
) -> UInt8[np.ndarray, "n 3"]:
    """`base` pale low down and full high up, so that walls and tables stand out from the floor."""
    share = height_share(height)[:, None]
    white = 0.5 * (1.0 - share) ** 2
    return np.clip(base * (1.0 - white) + 255.0 * white, 0, 255).astype(np.uint8)
