"""Sums over many points under many poses on a CPU: in pieces of few shapes, side by side on all cores.

A list of any length compiles nothing new, what a piece computes stays in the cache of a core, and memory does not grow
with the number of points or poses.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float32, Float64

from .._types import Array
from .buckets import pad_rows
from .tables import on_cpu
from .threads import num_cores, spread

PIECES = (128, 512, 1024, 4096, 16384)
"""Points of a piece: the smallest that holds the list, else the largest."""

LEAST_LOOKUPS = 1 << 20
"""Points times poses of a call at least, if one call is not enough."""

POSES = 512
"""Poses of a piece at most; how many of them there are is no part of its shape."""


def runs_in_pieces(*arrays: object) -> bool:
    """Whether arrays are values on a CPU: under a transformation of JAX and elsewhere all is one kernel."""
    return on_cpu() and not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays))


def over_poses(
    kernel: Callable[[np.ndarray, np.int32], Array], poses: Float32[np.ndarray, "k 4 4"], *, least_jobs: int
) -> np.ndarray:
    """What a kernel gives for each of any number of poses.

    Args:
        kernel: From poses (512, 4, 4) and the number of those that count to an array of 512 rows.
        poses: At least one.
        least_jobs: Cut them into at least so many calls, if there are so many poses: each core is to have one.

    Returns:
        One row a pose.
    """
    return np.concatenate(spread(partial(_of_group, kernel), _groups(poses, least_jobs)))


def sum_over_pieces(
    kernel: Callable[..., Array],
    lists: Sequence[np.ndarray],
    poses: Float32[np.ndarray, "k 4 4"],
    *,
    most: int = PIECES[-1],
) -> Float64[np.ndarray, "k m"]:
    """Sums over all points for each pose.

    Args:
        kernel: From lists of one of the lengths `PIECES` or `most`, poses (512, 4, 4), their number to sums (512, m).
            Rows of zeros in the lists must add nothing.
        lists: float32, one row a point each.
        poses: Of any number.
        most: Points of a piece at most.

    Returns:
        float64: sums of what the pieces give, in their order, whatever the number of cores.
    """
    length = len(lists[0])
    size = min(next((piece for piece in PIECES if piece >= length), most), most)
    starts = range(0, length, size)
    # As many calls as keep all cores busy, but none that is done before another thread has begun.
    num_calls = min(2 * num_cores(), -(-length * len(poses) // LEAST_LOOKUPS))
    groups = _groups(poses, -(-num_calls // len(starts)))

    def piece_from(start: int) -> list[np.ndarray]:
        parts = [rows[start : start + size] for rows in lists]
        return [part if len(part) == size else pad_rows(part, size) for part in parts]

    def sums_of(job: tuple[list[np.ndarray], np.ndarray]) -> np.ndarray:
        piece, group = job
        return _of_group(partial(kernel, *piece), group)

    found = spread(sums_of, product(map(piece_from, starts), groups))
    sums = [np.concatenate(found[k : k + len(groups)]) for k in range(0, len(found), len(groups))]
    return np.stack(sums).sum(axis=0, dtype=np.float64)


def _groups(poses: np.ndarray, least: int) -> list[np.ndarray]:
    """Poses in groups of at most `POSES`, in at least so many of them if there are so many poses."""
    size = max(min(-(-len(poses) // least), POSES), 1)
    return [poses[first : first + size] for first in range(0, len(poses), size)]


def _of_group(kernel: Callable[[np.ndarray, np.int32], Array], group: np.ndarray) -> np.ndarray:
    """One row of what the kernel gives for each pose of a group."""
    return np.asarray(kernel(pad_rows(group, POSES), np.int32(len(group))))[: len(group)]
