"""Tie-break between schemes of equal size: the transform with most fused voxels wins (section IV.C)."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..._types import OCCUPIED, Array
from ...grid import VoxelGrid


def count_fused_voxels(a: VoxelGrid, points_b: Float[Array, "n 3"], T_a_b: Float[Array, "4 4"]) -> int:
    """Occupied voxels of b whose centres fall into occupied voxels of a.

    Args:
        a: Map a.
        points_b: Centres of the occupied voxels of b [m].
        T_a_b: Maps points of b into a.
    """
    # The origin of a is taken off before the division by the voxel size, so that float32 rounds small numbers.
    T = np.asarray(T_a_b, np.float32)
    moved = np.asarray(points_b, np.float32) @ T[:3, :3].T + (T[:3, 3] - np.asarray(a.origin, np.float32))
    index = np.floor(moved / np.float32(a.voxel_size)).astype(np.int32)
    # Negative indices would wrap around in silence, and larger ones would be an error.
    index = index[((index >= 0) & (index < np.asarray(a.shape, np.int32))).all(axis=1)]
    return int(np.count_nonzero(np.asarray(a.states)[tuple(index.T)] == OCCUPIED))


def select_scheme(
    a: VoxelGrid,
    points_b: Float[Array, "n 3"],
    schemes: Sequence[np.ndarray],
    align: Callable[[np.ndarray], np.ndarray],
) -> tuple[int, np.ndarray, np.ndarray]:
    """The scheme whose transform fuses most voxels; the first of equals.

    Args:
        a: Map a.
        points_b: Centres of the occupied voxels of b [m].
        schemes: Associations (k, 2) each, at least one.
        align: Transform `T_a_b` of a scheme.

    Returns:
        Index of the scheme, the transforms of all (n, 4, 4), and their counts (n,).
    """
    poses = np.stack([np.asarray(align(scheme), np.float32) for scheme in schemes])
    counts = np.asarray([count_fused_voxels(a, points_b, T) for T in poses])
    return int(np.argmax(counts)), poses, counts
