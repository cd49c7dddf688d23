"""Block arrays made from others by changing some of their blocks; the others are taken over as they are."""

import numpy as np
from jaxtyping import Int

from .block_array import BlockArray
from .block_builder import BlockBuilder
from .words import BLOCK


def with_value(array: BlockArray, index: Int[np.ndarray, "n 3"], value: object) -> BlockArray:
    """An array with one value at listed voxels, and as it was elsewhere.

    Args:
        array: What is changed, in a copy.
        index: Voxels inside the box, in any order.
        value: What they hold then.
    """
    if not len(index):
        return array
    table = np.asarray(array.table)
    places = np.asarray(index, np.int64)
    block = np.asarray(np.ravel_multi_index(tuple((places // BLOCK).T), table.shape))
    touched, number = np.unique(block, return_inverse=True)
    blocks = np.asarray(array.pool)[table.reshape(-1)[touched]]
    blocks[(number, *(places % BLOCK).T)] = value
    builder = BlockBuilder(array.shape, array.dtype)
    is_other = table != 0
    is_other.reshape(-1)[touched] = False
    copy_blocks(builder, array, np.argwhere(is_other))
    builder.add(np.stack(np.unravel_index(touched, table.shape), axis=1), blocks)
    return builder.finish()


def zeroed_outside(array: BlockArray, mask: BlockArray) -> BlockArray:
    """An array that is 0 wherever another one of the same box is.

    Args:
        array: What is changed, in a copy.
        mask: Where it stays as it is, not 0.
    """
    rows, masks = np.asarray(mask.table), np.asarray(mask.pool)
    has_values = np.asarray(array.table) != 0
    is_full = np.asarray((masks != 0).all(axis=(1, 2, 3)))[rows]
    builder = BlockBuilder(array.shape, array.dtype)
    copy_blocks(builder, array, np.argwhere(has_values & is_full))
    index = np.argwhere(has_values & ~is_full & (rows != 0))
    step = 1 << 12
    for start in range(0, len(index), step):
        some = tuple(index[start : start + step].T)
        values = np.asarray(array.pool)[np.asarray(array.table)[some]]
        builder.add(
            index[start : start + step], np.where(masks[rows[some]] != 0, values, array.dtype.type(0))
        )
    return builder.finish()


def copy_blocks(builder: BlockBuilder, array: BlockArray, index: Int[np.ndarray, "m 3"]) -> None:
    """Put some blocks of an array into another one that is being built, at the same places.

    Args:
        builder: Builds an array of the same box.
        array: Where the blocks come from.
        index: Their places, which the builder has no blocks at yet.
    """
    rows, pool = np.asarray(array.table)[tuple(index.T)], np.asarray(array.pool)
    is_level = array.is_uniform[rows]
    builder.put(index[is_level], pool[rows[is_level], 0, 0, 0])
    index, rows = index[~is_level], rows[~is_level]
    # Few at a time: what is copied stays in the cache.
    step = 1 << 12
    for start in range(0, len(index), step):
        builder.add(index[start : start + step], pool[rows[start : start + step]])
