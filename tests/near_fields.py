"""The field of nearest voxels of a short padded list, for the tests of evidence."""

import numpy as np

from voxjax.ops.evidence.nearest import nearest_field


def field_of(index, dims, radius, flat_size=None):
    size = int(np.prod(dims)) if flat_size is None else flat_size
    padded = np.concatenate([index, np.zeros((3, 3), np.int32)]).astype(np.int32)
    mask = np.arange(len(padded)) < len(index)
    return nearest_field(padded, mask, np.asarray(dims, np.int32), flat_size=size, radius=radius)
