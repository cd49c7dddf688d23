"""A map as the leaves of its octree: cut and measured at a cost that follows the leaves, whatever box they span.

Keys count voxels along an axis from 0 to 65535, and OctoMap puts the origin of the frame at the low corner of voxel
32768. A pruned leaf stands for a cube of voxels and is never taken apart here.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._types import FREE, OCCUPIED
from .crop import cells_within

DEPTH = 16
NUM_KEYS = 1 << DEPTH


class Leaves(NamedTuple):
    """Leaves of one tree level.

    Attributes:
        depth: Tree level, 0 (the root) to 16; a leaf is `2 ** (16 - depth)` voxels wide.
        key: int32 (n, 3): key of the lowest voxel.
        value: (n,): what the leaf holds, a state (uint8) or log-odds (float32).
    """

    depth: int
    key: np.ndarray
    value: np.ndarray

    @property
    def width(self) -> int:
        """Edge length of a leaf [voxel]."""
        return NUM_KEYS >> self.depth

    def where(self, chosen: np.ndarray | slice) -> "Leaves":
        """The leaves that a mask or a slice chooses."""
        return Leaves(self.depth, self.key[chosen], self.value[chosen])

    def states(self) -> np.ndarray:
        """State uint8 (n,) of each leaf; OctoMap's own threshold is a probability of 0.5, log-odds of 0."""
        return self.value if self.value.dtype == np.uint8 else np.where(self.value >= 0, OCCUPIED, FREE)


class LeafMap(NamedTuple):
    """What a window of an octree holds; of leaves that reach out of it, only the part inside counts.

    Attributes:
        levels: Leaves of the levels that have any, the widest first; every leaf reaches into the window.
        resolution: Width of a voxel [m].
        has_log_odds: Whether the leaves hold log-odds, not states.
        low: int64 (3,): lowest key of the window, which is as small as the leaves allow.
        high: int64 (3,): one past its highest key.
    """

    levels: list[Leaves]
    resolution: float
    has_log_odds: bool
    low: np.ndarray
    high: np.ndarray

    @property
    def num_leaves(self) -> int:
        """Number of leaves of all levels."""
        return sum(len(level.key) for level in self.levels)

    @property
    def num_bytes(self) -> float:
        """Memory of the leaves [byte]."""
        return self.num_leaves * (16.0 if self.has_log_odds else 13.0)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels of the window along x, y, z."""
        x, y, z = (self.high - self.low).tolist()
        return x, y, z

    @property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Low and high corner of the window, float64 (3,) each [m]."""
        low, high = ((keys - NUM_KEYS // 2) * self.resolution for keys in (self.low, self.high))
        return low, high

    def count(self, state: np.uint8) -> int:
        """Number of voxels of a state, those inside of wide leaves too."""
        total = 0
        for level in self.levels:
            for piece in pieces(level):
                low, high = self.boxes(piece.where(piece.states() == state))
                total += int((high - low).prod(axis=1, dtype=np.int64).sum())
        return total

    def boxes(self, level: Leaves) -> tuple[np.ndarray, np.ndarray]:
        """Lowest key and one past the highest, int32 (n, 3) each, of the parts of leaves inside of the window."""
        low, high = self.low.astype(np.int32), self.high.astype(np.int32)
        return np.maximum(level.key, low), np.minimum(level.key + np.int32(level.width), high)

    def within(self, crop: tuple[np.ndarray, np.ndarray]) -> "LeafMap":
        """What lies between two corners [m], voxel by voxel as `crop.cells_within` has it."""
        origin = np.full(3, -(NUM_KEYS // 2) * self.resolution)
        return self.cut(*cells_within(crop, origin, self.resolution, (NUM_KEYS,) * 3))

    def cut(self, low: np.ndarray, high: np.ndarray) -> "LeafMap":
        """What lies in a window, from key `low` up to and without `high`, int64 (3,)."""
        low, high = np.maximum(low, self.low), np.minimum(high, self.high)
        # A window without voxels would lie inside of wide leaves.
        if (low >= high).any():
            return self.with_levels([])
        # Each leaf reaches into the new window or is left out, which is what `with_levels` asks for.
        kept = [
            level.where(np.all((level.key < high) & (level.key + level.width > low), axis=1))
            for level in self.levels
        ]
        return self._replace(low=low, high=high).with_levels(kept)

    def with_levels(self, levels: list[Leaves]) -> "LeafMap":
        """The same window with other leaves in it, and as small as they allow.

        Args:
            levels: Leaves by level, the widest first, of which some levels may have none. Each reaches into the window.
        """
        levels = [level for level in levels if len(level.key)]
        if not levels:
            nothing = np.full(3, NUM_KEYS // 2, np.int64)
            return self._replace(levels=[], low=nothing, high=nothing)
        # Axis by axis, for NumPy takes ten times as long for a list of rows of three.
        low = np.min([[along.min() for along in level.key.T] for level in levels], axis=0)
        # Leaves of one level are equally wide, so the highest key of each level tells where that level ends.
        high = np.max([[along.max() + level.width for along in level.key.T] for level in levels], axis=0)
        return self._replace(levels=levels, low=np.maximum(low, self.low), high=np.minimum(high, self.high))


def leaf_map(levels: list[Leaves], resolution: float, *, has_log_odds: bool) -> LeafMap:
    """The map of some leaves, which may be none.

    Args:
        levels: Leaves by level, the widest first, of which some levels may have none.
        resolution: Width of a voxel [m].
        has_log_odds: Whether the leaves hold log-odds, not states.
    """
    # Keys are int32, but products of the lengths of a box are not.
    everything = np.zeros(3, np.int64), np.full(3, NUM_KEYS, np.int64)
    return LeafMap([], resolution, has_log_odds, *everything).with_levels(levels)


def pieces(level: Leaves) -> Iterator[Leaves]:
    """The leaves of a level, some at a time: what is computed for all of them is several times as large as they are."""
    step = 1 << 15
    for start in range(0, len(level.key), step):
        yield level.where(slice(start, start + step))
