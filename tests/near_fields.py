"""Fields of nearest voxels for the tests of evidence: of short padded lists, and those of pools as dense arrays."""

import numpy as np

from voxjax.ops.evidence.lookup import cells_on_host
from voxjax.ops.evidence.nearest import nearest_field


def dense_field(pool, shape, table):
    """A pool of blocks as the dense array (x, y, z) of a box."""
    centres = [place + np.float32(0.5) for place in np.indices(shape, np.float32)]
    cells, is_inside = cells_on_host(centres, shape, np.asarray(table))
    assert is_inside.all()
    return np.asarray(pool)[cells]


def dense_values(prepared, pool):
    """One of the pools of a prepared map as a dense array."""
    return dense_field(pool, prepared.grid.shape, prepared.table)


def field_of(index, dims, radius, flat_size=None):
    size = int(np.prod(dims)) if flat_size is None else flat_size
    padded = np.concatenate([index, np.zeros((3, 3), np.int32)]).astype(np.int32)
    mask = np.arange(len(padded)) < len(index)
    return nearest_field(padded, mask, np.asarray(dims, np.int32), flat_size=size, radius=radius)
