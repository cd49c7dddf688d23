"""The octree inside OctoMap files: pre-order records to their keys.

An OctoMap tree is 16 levels deep; a voxel has a key of three numbers in 0..65535, and child c of a node
lies in the upper half along x, y, z where bit 0, 1, 2 of c is set. All work is vectorised, one pass a tree
level.
"""

import numpy as np

from .._checks import InputError
from .leaves import DEPTH, NUM_KEYS

INNER = 3  # beside the states 0 unknown, 1 free, 2 occupied: also the code of the binary format
CHILD_OFFSETS = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], np.int32)


def subtree_ends(num_children: np.ndarray) -> np.ndarray:
    """Index one past the subtree of each record of a pre-order list.

    Args:
        num_children: (n,) number of children with own records.

    Returns:
        int64 (n,).

    Raises:
        InputError: If the list ends inside the tree, goes on after it, or the tree is deeper than 16 levels.
    """
    # pending[i]: records announced before record i, less one; it falls below zero after the last.
    pending = np.zeros(len(num_children) + 1, np.int32)
    np.cumsum(num_children.astype(np.int32) - 1, out=pending[1:])
    # A damaged file is refused here, by sums alone, before anything follows its structure.
    complete = np.flatnonzero(pending < 0)
    if not complete.size:
        raise InputError("the data end before the tree is complete (truncated)")
    if complete[0] < len(num_children):
        raise InputError(
            f"{len(num_children) - complete[0]} records follow after the end of the tree (trailing bytes)"
        )
    # A pre-order walk never has more than 7 open siblings a level. Deeper trees are refused here already, because the
    # levels below are told apart in eight bits.
    most_pending = 7 * DEPTH
    if pending.max() > most_pending:
        raise InputError("the tree is deeper than 16 levels")
    # A step goes down by one at most, so the subtree of i ends where `pending` first falls below pending[i].
    # The sort is stable, because the search below wants the records of one level in their order; numbers of eight bits
    # take it one pass.
    order = np.argsort(pending.astype(np.int8), kind="stable")
    bounds = np.searchsorted(pending[order], np.arange(-1, most_pending + 2))
    ends = np.empty(len(num_children) + 1, np.int64)
    for level in range(most_pending + 1):
        here = order[bounds[level + 1] : bounds[level + 2]]
        if here.size:
            below = order[bounds[level] : bounds[level + 1]]
            ends[here] = below[np.searchsorted(below, here)]
    return ends[:-1]


def walk_levels(child_mask: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Records and keys of each tree level.

    Args:
        child_mask: uint8 (n,): bit c is set where child c of a record has a record of its own; pre-order.

    Returns:
        For depth 0, 1, ...: record numbers int64 (m,) and keys int32 (m, 3) of their lowest voxels.

    Raises:
        InputError: As in `subtree_ends`.
    """
    num_children = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.uint8)
    ends = subtree_ends(num_children[child_mask])
    record, key = np.zeros(1, np.int64), np.zeros((1, 3), np.int32)
    levels = []
    for depth in range(DEPTH + 1):
        levels.append((record, key))
        # At the last level this is 0: children below it are refused after the loop.
        half = NUM_KEYS >> (depth + 1)
        mask = child_mask[record]
        # In pre-order the first child follows its parent, and each other child the subtree of the one before.
        following = record + 1
        children, child_keys = [], []
        for c in range(8):
            has = np.flatnonzero(mask & np.uint8(1 << c))
            child = following[has]
            children.append(child)
            child_keys.append(key[has] + half * CHILD_OFFSETS[c])
            following[has] = ends[child]
        record, key = np.concatenate(children), np.concatenate(child_keys)
        if not record.size:
            return levels
    raise InputError("the tree is deeper than 16 levels")
