"""Trees of streets and forests: a trunk, and a crown of clusters of leaves with gaps between them."""

import numpy as np

from .place import Part, box


def make_tree(rng: np.random.Generator, *, height: float, clear: float) -> list[Part]:
    """A tree at the origin.

    Args:
        rng: Source of chance.
        height: Height of its top [m].
        clear: Height of its lowest leaves [m].
    """
    thick = 0.025 * height + rng.uniform(0.05, 0.2)
    yaw = rng.uniform(0.0, np.pi)
    parts = [box((0.0, 0.0), (thick, thick), (-1.0, 0.8 * height), "trunk", yaw)]
    reach = rng.uniform(0.12, 0.22) * height
    for _ in range(int(rng.integers(3, 6))):
        middle = rng.uniform(clear, height)
        # A crown is widest at a third of its height.
        wide = reach * (1.0 - 0.7 * abs((middle - clear) / (height - clear) - 0.33))
        centre = rng.normal(0.0, 0.45 * wide, 2)
        size = wide * rng.uniform(0.6, 1.3, 2)
        thickness = rng.uniform(0.3, 0.35 * (height - clear))
        parts.append(
            box(
                centre,
                (size[0], size[1]),
                (middle - 0.5 * thickness, middle + 0.5 * thickness),
                "tree",
                rng.uniform(0.0, np.pi),
            )
        )
    return parts
