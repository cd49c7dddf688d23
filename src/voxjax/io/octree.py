"""The octree inside OctoMap files: pre-order records to their keys, and dense voxels to pruned records.

An OctoMap tree is 16 levels deep; a voxel has a key of three numbers in 0..65535, and child c of a node
lies in the upper half along x, y, z where bit 0, 1, 2 of c is set. All work is vectorised, one pass a tree
level.
"""

from typing import NamedTuple

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


class TreeLevel(NamedTuple):
    """Nodes of one tree level inside a dense box.

    Attributes:
        low: int64 (3,): key of the lowest node, in nodes of this level.
        code: uint8 (x, y, z): 0 unknown, 1 free leaf, 2 occupied leaf, 3 inner node.
        value: float32 (x, y, z): log-odds of leaves, highest below inner nodes; None for binary trees.
    """

    low: np.ndarray
    code: np.ndarray
    value: np.ndarray | None


def prune(states: np.ndarray, value: np.ndarray | None, low: np.ndarray) -> list[TreeLevel]:
    """The pruned tree of a dense box of voxels, from the root (level 0) to the voxels (level 16).

    Eight equal leaves become one. Levels below the root are padded to even bounds, so that the children of
    node n of a level lie at `2 n - low` to `2 n - low + 1` of the next.
    """
    levels = [TreeLevel(np.asarray(low, np.int64), states, value)]
    for _ in range(DEPTH):
        child = _pad_to_even(levels[-1])
        # The padded level replaces its own, since the indices of `children_of` count from its corner.
        levels[-1] = child
        views = [child.code[i::2, j::2, k::2] for i, j, k in CHILD_OFFSETS]
        # Eight equal inner nodes are no leaf: what lies below them differs.
        is_leaf = (views[0] == 1) | (views[0] == 2)
        is_known = views[0] != 0
        for view in views[1:]:
            is_leaf &= view == views[0]
            is_known |= view != 0
        value = None
        if child.value is not None:
            values = [child.value[i::2, j::2, k::2] for i, j, k in CHILD_OFFSETS]
            for other in values[1:]:
                is_leaf &= other == values[0]
            # As in OctoMap, an inner node has the highest log-odds below it, and unknown children have none.
            lowest = np.float32(-np.inf)
            value = np.max([np.where(c != 0, v, lowest) for c, v in zip(views, values, strict=True)], axis=0)
        code = np.where(is_leaf, views[0], np.where(is_known, np.uint8(INNER), np.uint8(0)))
        levels.append(TreeLevel(child.low // 2, code, value))
    return levels[::-1]


def children_of(levels: list[TreeLevel], depth: int, index: np.ndarray) -> np.ndarray:
    """Indices int64 (m, 8, 3), in the next level, of the children of nodes (m, 3) of a level."""
    # Keys double from one level to the next; each level counts its indices from its own corner.
    first_child = 2 * (index + levels[depth].low) - levels[depth + 1].low
    return first_child[:, None, :] + CHILD_OFFSETS


def pre_order(key: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Sort order of nodes for a pre-order list.

    Args:
        key: int64 (n, 3): key of each node's lowest voxel.
        depth: (n,): tree level of each node.
    """
    code = np.zeros(len(key), np.uint64)
    for axis in range(3):
        bits = key[:, axis].astype(np.uint64)
        for shift, mask in (
            (16, 0x0000FF0000FF),
            (8, 0x00F00F00F00F),
            (4, 0x0C30C30C30C3),
            (2, 0x249249249249),
        ):
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)  # spreads 16 bits to every third place
        code |= bits << np.uint64(axis)
    # A parent has the key of its first child and must come before it: the depth, 16 at most, stands in five bits below.
    return np.argsort(code << np.uint64(5) | depth.astype(np.uint64))


def _pad_to_even(level: TreeLevel) -> TreeLevel:
    # Voxels outside of the box are unknown, which is what padding with zeros says.
    before = level.low % 2
    after = (level.low + level.code.shape) % 2
    if not before.any() and not after.any():
        return level
    width = tuple((int(b), int(a)) for b, a in zip(before, after, strict=True))
    value = None if level.value is None else np.pad(level.value, width)
    return TreeLevel(level.low - before, np.pad(level.code, width), value)
