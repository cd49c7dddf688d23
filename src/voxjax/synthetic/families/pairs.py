"""Two maps of a place, or of two, that overlap by as much as is asked for."""

import numpy as np
from scipy.spatial import KDTree

from .visitor import Visitor


def choose_parts(
    rng: np.random.Generator, a: Visitor, b: Visitor, overlap: float, reach: float
) -> tuple[range, range]:
    """The scans of both robots whose maps overlap by about as much as is wanted.

    Robot b's part is moved along the way until the share fits, by bisection: parts farther apart share less.

    Args:
        rng: Source of chance.
        a: Robot that starts first.
        b: Robot in the same place.
        overlap: Share of the voxels of one map that lie on the other, the smaller of both ways.
        reach: Largest distance that two voxels which lie on each other have [m].
    """
    total = min(len(a), len(b))
    is_back = bool(rng.integers(2))
    best, error = (range(0), range(0)), np.inf
    # A way that comes back to where it was shares more again farther on, where a search can be trapped.
    for _ in range(4):
        # Enough of the way is left before b for parts that see nothing of each other.
        start = int(rng.integers(max(total - 2 * (a.num_scans + b.num_scans), 0) + 1))
        low, high = 0, max(total - b.num_scans - start, 0)
        while low <= high:
            shift = (low + high) // 2
            first = range(start, start + a.num_scans)
            second = range(start + shift, start + shift + b.num_scans)
            parts = (_turned(first, total), _turned(second, total)) if is_back else (first, second)
            share = shared(a.cloud(parts[0]), b.cloud(parts[1]), reach)
            # Shares are compared as ratios: 0.05 instead of 0.1 is as far off as 0.4 instead of 0.8.
            gap = abs(np.log((share + 1e-3) / (overlap + 1e-3)))
            if gap < error:
                best, error = parts, gap
            if gap < 0.05:
                break
            low, high = (shift + 1, high) if share > overlap else (low, shift - 1)
        if error < np.log(1.25):
            break
    return best


def shared(a: np.ndarray, b: np.ndarray, reach: float) -> float:
    """Share of the points (n, 3) of one cloud within `reach` [m] of the other, the smaller of both ways."""
    # A few thousand points tell the share to a percent.
    most = 4000
    shares = []
    for points, others in ((a, b), (b, a)):
        asked = points[:: max(len(points) // most, 1)]
        tree = KDTree(others, balanced_tree=False, compact_nodes=False)
        shares.append(np.isfinite(tree.query(asked, distance_upper_bound=reach)[0]).mean())
    return float(min(shares))


def any_part(rng: np.random.Generator, visitor: Visitor) -> range:
    """The scans of any part of the way."""
    start = int(rng.integers(max(len(visitor) - visitor.num_scans, 0) + 1))
    return range(start, start + visitor.num_scans)


def _turned(part: range, total: int) -> range:
    """The part counted from the other end of the way."""
    return range(total - part.stop, total - part.start)
