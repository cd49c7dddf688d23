"""Bytes of OctoMap files as the leaves of their trees, for readers of grids and for whoever only counts."""

from functools import cache
from typing import NamedTuple

import numpy as np

from .._checks import InputError
from .._types import FREE, OCCUPIED
from .budget import Budget
from .leaves import DEPTH, NUM_KEYS, LeafMap, Leaves, leaf_map
from .octomap_header import BINARY_LINE, FULL_LINE, Header, read_header, read_legacy_header
from .octree import CHILD_OFFSETS, INNER, walk_levels

# NumPy's records have no gaps between their fields unless told to, and neither have those of the files.
PLAIN_NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])
COLOR_NODE = np.dtype([("log_odds", "<f4"), ("rgb", "u1", 3), ("children", "u1")])


def leaves_of_bt(data: bytes, budget: Budget | None = None) -> LeafMap:
    """Leaves of a `.bt` file, with states.

    Args:
        data: The whole file.
        budget: What reading may take; None for what a file of this size may.

    Raises:
        InputError: If the bytes are no whole binary OctoMap file, or need more memory than they may.
    """
    budget = Budget(len(data)) if budget is None else budget
    header = read_header(data) if data.startswith(BINARY_LINE) else read_legacy_header(data)
    if _is_empty(header, data):
        return leaf_map([], header.resolution, has_log_odds=False)
    if (len(data) - header.start) % 2:
        raise InputError(
            "the data hold an odd number of bytes, but nodes take two each (truncated or trailing bytes)"
        )
    words = np.frombuffer(data, "<u2", offset=header.start)
    # Bytes that were seen for a record; below, those for a leaf and for what is looked at at a time.
    walk = 45 * len(words)
    budget.check(walk, "the tree in the file")
    tables = _word_tables()
    num_leaves = tables.num_leaves[words]
    listing = 24 * len(words) + 14 * int(num_leaves.sum(dtype=np.int64)) + 500_000
    budget.check(max(walk, listing), "the tree in the file")
    # Leaves stand in the word of their parent, so that inner nodes alone have records to walk.
    levels = walk_levels(tables.inner_mask[words])
    # Every node but the root is one code that is not 0, in the record of its parent.
    _check_size(header.num_nodes, 1 + int(tables.num_children[words].sum(dtype=np.int64)))
    if not words.all():
        raise InputError("an inner node has no children")
    leaves = []
    # The codes of a record are of its children, one level further down.
    for depth, (record, key) in enumerate(levels, start=1):
        if depth > DEPTH:
            raise InputError("the tree is deeper than 16 levels")
        leaves.append(_leaf_children(words, num_leaves, record, key, depth))
    return leaf_map(leaves, header.resolution, has_log_odds=False)


def leaves_of_ot(data: bytes, budget: Budget | None = None) -> LeafMap:
    """Leaves of an `.ot` file, with log-odds.

    Args:
        data: The whole file.
        budget: What reading may take; None for what a file of this size may.

    Raises:
        InputError: If the bytes are no whole OctoMap file of OcTree or ColorOcTree nodes, hold log-odds that are not
            finite, or need more memory than they may.
    """
    budget = Budget(len(data)) if budget is None else budget
    if not data.startswith(FULL_LINE):
        raise InputError(f"the first line must be {FULL_LINE.decode()!r}")
    header = read_header(data)
    if _is_empty(header, data):
        return leaf_map([], header.resolution, has_log_odds=True)
    node = COLOR_NODE if header.tree_type == "ColorOcTree" else PLAIN_NODE
    if (len(data) - header.start) % node.itemsize:
        raise InputError(
            f"the data are no whole number of nodes of {node.itemsize} bytes (truncated or trailing bytes)"
        )
    nodes = np.frombuffer(data, node, offset=header.start)
    num_leaves = len(nodes) - int(np.count_nonzero(nodes["children"]))
    # Bytes that were seen for a record, and for a leaf beside its record.
    budget.check(30 * len(nodes) + 30 * num_leaves, "the tree in the file")
    # Here leaves have records as well, so all records are walked; colours are passed over.
    levels = walk_levels(np.ascontiguousarray(nodes["children"]))
    _check_size(header.num_nodes, len(nodes))
    if not np.isfinite(nodes["log_odds"]).all():
        raise InputError("log-odds must be finite, but some are NaN or infinite")
    leaves = []
    for depth, (record, key) in enumerate(levels):
        is_leaf = nodes["children"][record] == 0
        leaves.append(Leaves(depth, key[is_leaf], nodes["log_odds"][record[is_leaf]]))
    return leaf_map(leaves, header.resolution, has_log_odds=True)


def _codes_of(words: np.ndarray) -> np.ndarray:
    """Codes uint8 (n, 8) of the children in words: two bits for each, those of the first child lowest."""
    return (words[:, None] >> np.arange(0, 16, 2, dtype=np.uint16)).astype(np.uint8) & np.uint8(3)


class _WordTables(NamedTuple):
    """What a word of a binary tree says, by its value.

    Attributes:
        inner_mask: uint8 (65536,): bit c is set where child c has a word of its own.
        num_leaves: uint8 (65536,): how many children are leaves.
        num_children: uint8 (65536,): how many children there are.
    """

    inner_mask: np.ndarray
    num_leaves: np.ndarray
    num_children: np.ndarray


@cache
def _word_tables() -> _WordTables:
    codes = _codes_of(np.arange(1 << 16, dtype=np.uint16))
    return _WordTables(
        np.packbits(codes == INNER, axis=1, bitorder="little")[:, 0],
        ((codes == FREE) | (codes == OCCUPIED)).sum(axis=1, dtype=np.uint8),
        (codes != 0).sum(axis=1, dtype=np.uint8),
    )


def _leaf_children(
    words: np.ndarray, num_leaves: np.ndarray, record: np.ndarray, key: np.ndarray, depth: int
) -> Leaves:
    """Leaves among the children of some records of a binary tree.

    Args:
        words: uint16 (n,): the records of the file.
        num_leaves: uint8 (n,): how many of the children of each are leaves.
        record: int64 (m,): the parents.
        key: int32 (m, 3): keys of their lowest voxels.
        depth: Level of the children.
    """
    offsets, step = ((NUM_KEYS >> depth) * CHILD_OFFSETS).astype(np.int32), 1 << 14
    count = int(num_leaves[record].sum(dtype=np.int64))
    keys, values, end = np.empty((count, 3), np.int32), np.empty(count, np.uint8), 0
    # Some records at a time: the places of leaves among all codes take more memory than the leaves.
    for start in range(0, len(record), step):
        word, parent = words[record[start : start + step]], key[start : start + step]
        for child, offset in enumerate(offsets):
            code = (word >> np.uint16(2 * child)).astype(np.uint8) & np.uint8(3)
            # Of the codes 0 to 3, those of leaves are 1 and 2: less one, 0 becomes 255.
            has = np.flatnonzero(code - np.uint8(1) < 2)
            begin, end = end, end + len(has)
            np.add(parent[has], offset, out=keys[begin:end])
            np.take(code, has, out=values[begin:end])
    return Leaves(depth, keys, values)


def _is_empty(header: Header, data: bytes) -> bool:
    """Whether a file says that it has no nodes."""
    if header.num_nodes == 0 and header.start < len(data):
        raise InputError("the header says 0 nodes, but data follow (trailing bytes)")
    return header.num_nodes == 0


def _check_size(stated: int, found: int) -> None:
    if stated != found:
        raise InputError(f"the header says {stated:,} nodes, but the data hold {found:,}")
