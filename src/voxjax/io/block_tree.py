"""Blocks of a map pruned into an octree, and the records of its nodes as OctoMap files have them.

A family is the eight children of a node. The families of a level stand in Morton order, so that those of the next level
are found by looking at eight codes in a row; only families that exist are looked at, not the whole box.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray
from .key_blocks import key_block_codes, key_blocks
from .leaves import DEPTH
from .octree import INNER

BLOCK_DEPTH = DEPTH - 3
"""Tree level of the nodes that are eight voxels wide."""


class Families(NamedTuple):
    """Children of inner nodes of one tree level.

    Attributes:
        depth: Tree level of the parents.
        parent: int64 (n,): numbers of the parents in Morton order.
        code: uint8 (n, 8): 0 unknown, 1 free leaf, 2 occupied leaf, 3 inner node.
        value: float32 (n, 8): log-odds of leaves, highest below inner nodes; None for binary trees.
    """

    depth: int
    parent: np.ndarray
    code: np.ndarray
    value: np.ndarray | None

    def order_of(self, depth: int, node: np.ndarray) -> np.ndarray:
        """Numbers int64 by which nodes of a level stand in pre-order among all nodes."""
        # A parent has the place of its first child and must come before it: the depth, 16 at most, stands in five bits.
        return node << (3 * (DEPTH - depth) + 5) | depth


def families(
    states: BlockArray, log_odds: BlockArray | None, low: np.ndarray, levels: np.ndarray | None = None
) -> Iterator[Families]:
    """The children of all inner nodes of the pruned tree of a map.

    Args:
        states: The map.
        log_odds: Its log-odds, or None.
        low: int64 (3,): key of its voxel (0, 0, 0).
        levels: float32 (3,): log-odds of each state, for a map without; None for a binary tree.
    """
    codes = key_block_codes(states, low)
    kept, kept_values = [np.zeros(0, np.uint8)], [np.zeros(0, np.float32)]
    odds = None if log_odds is None else key_blocks(log_odds, low, codes)
    for part in key_blocks(states, low, codes):
        value, is_level, code = None, part.is_level, np.zeros((0, BLOCK_VOXELS), np.uint8)
        top_value = None if levels is None else levels[part.level]
        if odds is not None:
            of_odds = next(odds)
            is_level, top_value = is_level & of_odds.is_level, of_odds.level.copy()
            value = _voxels(of_odds.is_level, of_odds.level, of_odds.values, ~is_level)
        code = _voxels(part.is_level, part.level, part.values, ~is_level)
        if levels is not None and odds is None:
            value = levels[code]
        top = part.level.copy()
        node = part.code[~is_level]
        for depth in (DEPTH - 1, DEPTH - 2, BLOCK_DEPTH):
            # Parents of one level stand in the order of their blocks, and within these in Morton order.
            code, value = code.reshape(-1, 8), None if value is None else value.reshape(-1, 8)
            along = 8 ** (depth - BLOCK_DEPTH)
            parent = (node[:, None] * along + np.arange(along)).reshape(-1)
            made = Families(depth, parent, code, value)
            code, value = _pruned(made)
            yield _inner(made, code)
        top[~is_level] = code
        kept.append(top)
        if top_value is not None:
            top_value[~is_level] = value
            kept_values.append(top_value)
    has_values = log_odds is not None or levels is not None
    yield from _upper(codes, np.concatenate(kept), np.concatenate(kept_values) if has_values else None)


def words_of(code: np.ndarray) -> np.ndarray:
    """Records uint16 (n,) of a binary tree: two bits for each of the codes uint8 (n, 8), those of the first lowest."""
    word = np.ascontiguousarray(code).view("<u8")[:, 0].astype(np.uint64)
    for shift, mask in ((6, 0x000F000F000F000F), (12, 0x000000FF000000FF), (24, 0xFFFF)):
        word = (word | word >> np.uint64(shift)) & np.uint64(mask)
    return word.astype(np.uint16)


def _voxels(is_level: np.ndarray, level: np.ndarray, values: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Voxels (m, 512) of the nodes that are chosen, among them all that do not hold one value alone."""
    voxels = np.repeat(level[chosen, None], BLOCK_VOXELS, axis=1)
    voxels[~is_level[chosen]] = values
    return voxels


def _pruned(made: Families) -> tuple[np.ndarray, np.ndarray | None]:
    """Codes uint8 (n,) and values (n,) of parents: eight equal leaves are one."""
    code, value = made.code, made.value
    first = code[:, 0]
    word = np.ascontiguousarray(code).view(np.uint64)[:, 0]
    # Eight equal inner nodes are no leaf: what lies below them differs.
    is_leaf = (word == first * np.uint64(0x0101010101010101)) & (first != 0) & (first != INNER)
    highest = None
    if value is not None:
        # As in OctoMap, an inner node has the highest log-odds below it, and unknown children have none.
        highest = np.full(len(code), -np.inf, np.float32)
        for child in range(8):
            np.maximum(highest, value[:, child], out=highest, where=code[:, child] != 0)
            is_leaf &= value[:, child] == value[:, 0]
    return np.where(is_leaf, first, np.where(word != 0, np.uint8(INNER), np.uint8(0))), highest


def _inner(made: Families, code: np.ndarray) -> Families:
    """The families of those parents that are inner nodes, by the codes of all parents."""
    chosen = np.flatnonzero(code == INNER)
    value = None if made.value is None else made.value[chosen]
    return Families(made.depth, made.parent[chosen], made.code[chosen], value)


def _upper(node: np.ndarray, code: np.ndarray, value: np.ndarray | None) -> Iterator[Families]:
    """Families above the nodes that are eight voxels wide, up to the root.

    Args:
        node: int64 (n,): numbers of these nodes in Morton order, ascending.
        code: uint8 (n,): what they are.
        value: float32 (n,): their log-odds, or None.
    """
    for depth in range(BLOCK_DEPTH - 1, -1, -1):
        parent = node >> 3
        is_first = np.diff(parent, prepend=-1) != 0
        family, child = np.cumsum(is_first) - 1, node & 7
        codes = np.zeros((np.count_nonzero(is_first), 8), np.uint8)
        codes[family, child] = code
        values = None
        if value is not None:
            values = np.zeros(codes.shape, np.float32)
            values[family, child] = value
        made = Families(depth, parent[is_first], codes, values)
        node, (code, value) = made.parent, _pruned(made)
        yield _inner(made, code)
