"""Which listed voxels touch each other; work grows with the list, not with the volume."""

from itertools import product

import numpy as np
from jaxtyping import Int32


def neighbour_pairs(index: Int32[np.ndarray, "n 3"]) -> Int32[np.ndarray, "m 2"]:
    """Pairs of rows whose voxels share a face, an edge or a corner, each pair once.

    Args:
        index: Distinct voxel indices in lexicographic order, as `VoxelGrid.occupied_index` gives them.

    Returns:
        int32 (m, 2) row numbers, smaller index first; each column is contiguous in memory.
    """
    if len(index) == 0:
        return np.zeros((0, 2), np.int32)
    # A border of one voxel on each side keeps steps from wrapping into the next row of the key.
    local = index.astype(np.int64) - index.min(axis=0) + 1
    shape = local.max(axis=0) + 2
    strides = np.asarray([shape[1] * shape[2], shape[2], 1])
    keys = local @ strides
    rows = np.arange(len(keys), dtype=np.int32)
    pairs = []
    for step in product((-1, 0, 1), repeat=3):
        if step > (0, 0, 0):
            wanted = keys + int(np.dot(step, strides))
            found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            hit = keys[found] == wanted
            pairs.append(np.stack([rows[hit], found[hit].astype(np.int32)]))
    return np.concatenate(pairs, axis=1).T
