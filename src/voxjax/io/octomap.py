"""OctoMap files, `.bt` (occupied or free) and `.ot` (log-odds), without OctoMap.

OctoMap's voxel k fills `[k - 32768, k - 32767) * resolution` along an axis, so the origin of a grid (the
outer corner of its lowest voxel) is a whole multiple of the voxel size; other grids must be resampled
first.
"""

import math

import numpy as np

from .._checks import InputError
from .._runtime.memory import check_memory
from .._types import FREE, OCCUPIED, UNKNOWN
from ..grid import VoxelGrid
from .budget import Budget
from .octomap_header import BINARY_LINE, FULL_LINE, Header, read_header, read_legacy_header, write_header
from .octree import (
    CHILD_OFFSETS,
    DEPTH,
    INNER,
    NUM_KEYS,
    Leaves,
    TreeLevel,
    bounding_box,
    children_of,
    paint,
    pre_order,
    prune,
    walk_levels,
)

# What OctoMap gives to the leaves of a binary file: its clamping thresholds, probabilities 0.971 and 0.1192.
LOG_ODDS_OCCUPIED = np.float32(math.log(0.971 / 0.029))
LOG_ODDS_FREE = np.float32(math.log(0.1192 / 0.8808))

# NumPy's records have no gaps between their fields unless told to, and neither have those of the files.
_PLAIN_NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])
_COLOR_NODE = np.dtype([("log_odds", "<f4"), ("rgb", "u1", 3), ("children", "u1")])


def decode_bt(data: bytes, *, max_voxels: int | None = None) -> VoxelGrid:
    """Read the bytes of a `.bt` file; the grid is the bounding box of the known voxels, without log-odds.

    Args:
        data: The whole file.
        max_voxels: Largest grid; None for what a file of this size can need.

    Raises:
        InputError: If the bytes are no whole binary OctoMap file, or expand to more than the limit.
    """
    # The most that was seen in a walk: 49 bytes for each byte of a file whose nodes have eight leaves each.
    budget, walk = Budget(len(data), max_voxels), 64 * len(data)
    budget.check(walk, "the tree in the file")
    header = read_header(data) if data.startswith(BINARY_LINE) else read_legacy_header(data)
    if header.num_nodes == 0:
        return _empty_grid(header, data, with_log_odds=False)
    leaves = _leaves_of_bt(data, header)
    low, shape, origin = _box_of(leaves, header.resolution)
    budget.check_grid(shape, 1, walk)
    return VoxelGrid(paint(leaves, low, shape, np.uint8), origin, header.resolution)


def decode_ot(data: bytes, *, max_voxels: int | None = None) -> VoxelGrid:
    """Read the bytes of an `.ot` file; log-odds are kept, and a voxel is occupied where they are 0 or more.

    Args:
        data: The whole file.
        max_voxels: Largest grid; None for what a file of this size can need.

    Raises:
        InputError: If the bytes are no whole OctoMap file of OcTree or ColorOcTree nodes, hold log-odds
            that are not finite, or expand to more than the limit.
    """
    # The most that was seen in a walk: 13 bytes for each byte of a file whose nodes have eight leaves each.
    budget, walk = Budget(len(data), max_voxels), 20 * len(data)
    budget.check(walk, "the tree in the file")
    if not data.startswith(FULL_LINE):
        raise InputError(f"the first line must be {FULL_LINE.decode()!r}")
    header = read_header(data)
    if header.num_nodes == 0:
        return _empty_grid(header, data, with_log_odds=True)
    leaves = _leaves_of_ot(data, header)
    low, shape, origin = _box_of(leaves, header.resolution)
    budget.check_grid(shape, 5, walk)
    log_odds = paint(leaves, low, shape, np.float32)
    # OctoMap's own threshold is a probability of 0.5, log-odds of 0.
    states = [Leaves(d, key, np.where(value >= 0, OCCUPIED, FREE)) for d, key, value in leaves]
    return VoxelGrid(paint(states, low, shape, np.uint8), origin, header.resolution, log_odds)


def _leaves_of_bt(data: bytes, header: Header) -> list[Leaves]:
    """Leaves of a binary tree, with states, level by level."""
    if (len(data) - header.start) % 2:
        raise InputError(
            "the data hold an odd number of bytes, but nodes take two each (truncated or trailing bytes)"
        )
    words = np.frombuffer(data, "<u2", offset=header.start)
    # A record has two bits for each of the eight children, those of the first child lowest.
    codes = (words[:, None] >> np.arange(0, 16, 2, dtype=np.uint16)).astype(np.uint8) & np.uint8(3)
    # Leaves stand in the word of their parent, so that inner nodes alone have records to walk.
    levels = walk_levels(codes == INNER)
    # Every node but the root is one code that is not 0, in the record of its parent.
    _check_size(header.num_nodes, 1 + int(np.count_nonzero(codes)))
    if not words.all():
        raise InputError("an inner node has no children")
    leaves = []
    # The codes of a record are of its children, one level further down.
    for depth, (record, key) in enumerate(levels, start=1):
        if depth > DEPTH:
            raise InputError("the tree is deeper than 16 levels")
        is_leaf = (codes[record] == FREE) | (codes[record] == OCCUPIED)
        row, child = np.nonzero(is_leaf)
        leaf_key = key[row]
        leaf_key += ((NUM_KEYS >> depth) * CHILD_OFFSETS)[child]
        leaves.append(Leaves(depth, leaf_key, codes[record[row], child]))
    return [level for level in leaves if len(level.key)]


def _leaves_of_ot(data: bytes, header: Header) -> list[Leaves]:
    """Leaves of a full tree, with log-odds, level by level."""
    node = _COLOR_NODE if header.tree_type == "ColorOcTree" else _PLAIN_NODE
    if (len(data) - header.start) % node.itemsize:
        raise InputError(
            f"the data are no whole number of nodes of {node.itemsize} bytes (truncated or trailing bytes)"
        )
    nodes = np.frombuffer(data, node, offset=header.start)
    # Here leaves have records as well, so all records are walked; colours are passed over.
    levels = walk_levels(np.unpackbits(nodes["children"][:, None], axis=1, bitorder="little").astype(bool))
    _check_size(header.num_nodes, len(nodes))
    if not np.isfinite(nodes["log_odds"]).all():
        raise InputError("log-odds must be finite, but some are NaN or infinite")
    leaves = []
    for depth, (record, key) in enumerate(levels):
        is_leaf = nodes["children"][record] == 0
        leaves.append(Leaves(depth, key[is_leaf], nodes["log_odds"][record[is_leaf]]))
    return [level for level in leaves if len(level.key)]


def encode_bt(grid: VoxelGrid) -> bytes:
    """Bytes of the pruned `.bt` file of a grid; log-odds are left out.

    Raises:
        InputError: If the grid does not lie on OctoMap's lattice or within its range.
    """
    low, states, _ = _known_box(grid)
    if low is None:
        return write_header(BINARY_LINE, 0, grid.voxel_size)
    levels = prune(states, None, low)
    _check_nodes(levels, ".bt", 350)
    keys, depths, words, num_nodes = [], [], [], 1
    for depth in range(DEPTH):
        index = np.argwhere(levels[depth].code == INNER)
        children = children_of(levels, depth, index)
        # The word of an inner node holds two bits for each child; leaves have no word of their own.
        codes = levels[depth + 1].code[tuple(np.moveaxis(children, -1, 0))].astype(np.uint16)
        num_nodes += int(np.count_nonzero(codes))
        words.append((codes << np.arange(0, 16, 2, dtype=np.uint16)).sum(axis=1, dtype=np.uint16))
        # A node's key is that of its lowest voxel, so that nodes of all levels are sorted together.
        keys.append((index + levels[depth].low) << (DEPTH - depth))
        depths.append(np.full(len(index), depth, np.uint8))
    order = pre_order(np.concatenate(keys), np.concatenate(depths))
    return (
        write_header(BINARY_LINE, num_nodes, grid.voxel_size)
        + np.concatenate(words)[order].astype("<u2").tobytes()
    )


def encode_ot(grid: VoxelGrid) -> bytes:
    """Bytes of the pruned `.ot` file of a grid.

    A grid without log-odds gets OctoMap's clamping values, 3.51 for occupied and -2.0 for free voxels.

    Raises:
        InputError: If the grid does not lie on OctoMap's lattice or within its range, or its log-odds are not
            finite or contradict its states.
    """
    low, states, log_odds = _known_box(grid)
    if low is None:
        return write_header(FULL_LINE, 0, grid.voxel_size)
    # The most that was seen: 13 bytes for a voxel, most of them before nodes are made.
    check_memory(13.0 * states.size, "the map as .ot", "write it as .npz", on_device=False)
    if log_odds is None:
        # States are the places in this table; what stands for unknown ones is never written.
        log_odds = np.array([0.0, LOG_ODDS_FREE, LOG_ODDS_OCCUPIED], np.float32)[states]
    levels = prune(states, _checked_log_odds(states, log_odds), low)
    _check_nodes(levels, ".ot", 1000)
    keys, depths, nodes = [], [], []
    # The root is the one node of level 0. From it down, only nodes that exist are looked at, not the whole box.
    index = np.zeros((1, 3), np.int64)
    for depth, level in enumerate(levels):
        at = tuple(index.T)
        assert level.value is not None
        node = np.zeros(len(index), _PLAIN_NODE)
        node["log_odds"] = level.value[at]
        keys.append((index + level.low) << (DEPTH - depth))
        depths.append(np.full(len(index), depth, np.uint8))
        nodes.append(node)
        is_inner = level.code[at] == INNER
        if is_inner.any():
            children = children_of(levels, depth, index[is_inner])
            is_child = levels[depth + 1].code[tuple(np.moveaxis(children, -1, 0))] != 0
            node["children"][is_inner] = np.packbits(is_child, axis=1, bitorder="little")[:, 0]
            index = children[is_child]
        else:
            break
    order = pre_order(np.concatenate(keys), np.concatenate(depths))
    return write_header(FULL_LINE, len(order), grid.voxel_size) + np.concatenate(nodes)[order].tobytes()


def _empty_grid(header: Header, data: bytes, *, with_log_odds: bool) -> VoxelGrid:
    """The map of a file that says it has no nodes: one unknown voxel."""
    if header.start < len(data):
        raise InputError("the header says 0 nodes, but data follow (trailing bytes)")
    unknown = np.zeros((1, 1, 1), np.uint8)
    log_odds = unknown.astype(np.float32) if with_log_odds else None
    return VoxelGrid(unknown, np.zeros(3, np.float32), header.resolution, log_odds)


def _box_of(leaves: list[Leaves], resolution: float) -> tuple[np.ndarray, tuple[int, int, int], np.ndarray]:
    """Lowest key int64 (3,), number of voxels and origin float32 (3,) [m] of the box around all leaves."""
    low, shape = bounding_box(leaves)
    # OctoMap's keys are counted from its lowest voxel, and half of them lie below the frame's origin.
    origin = ((low - NUM_KEYS // 2) * resolution).astype(np.float32)
    return low, (int(shape[0]), int(shape[1]), int(shape[2])), origin


def _check_nodes(levels: list[TreeLevel], ending: str, bytes_per_inner: int) -> None:
    """Refuse a tree for which the memory does not suffice, before its nodes are made.

    Args:
        levels: The tree as it was pruned.
        ending: Ending of the file to write.
        bytes_per_inner: The most that was seen for an inner node and its eight children [byte].
    """
    num_inner = sum(int(np.count_nonzero(level.code == INNER)) for level in levels)
    need = float(num_inner * bytes_per_inner)
    check_memory(need, f"the map as {ending}", "write it as .npz", on_device=False)


def _known_box(grid: VoxelGrid) -> tuple[np.ndarray | None, np.ndarray, np.ndarray | None]:
    """Lowest key (None when nothing is known), states and log-odds of the known part of a grid."""
    # Unknown voxels have no nodes, and a smaller box is faster to prune.
    grid = grid.crop_to_known()
    states = np.asarray(grid.states)
    if not states.any():
        return None, states, None
    cell = np.asarray(grid.origin, np.float64) / grid.voxel_size
    low = np.rint(cell).astype(np.int64)
    # A hundredth of a voxel off the lattice is rounding: float32 is good to 0.002 at OctoMap's farthest voxel.
    if np.abs(cell - low).max() > 0.01:
        raise InputError(
            f"OctoMap files need an origin at whole multiples of the voxel size {grid.voxel_size:g} m, got "
            f"{np.asarray(grid.origin).tolist()}; resample it first with with_voxel_size (--voxel-size)"
        )
    low += NUM_KEYS // 2
    if (low < 0).any() or (low + states.shape > NUM_KEYS).any():
        raise InputError(
            f"OctoMap files reach {NUM_KEYS // 2} voxels from the frame's origin along each axis, and this "
            f"grid lies farther out, from voxel {(low - NUM_KEYS // 2).tolist()}; move it or use .npz"
        )
    return low, states, None if grid.log_odds is None else np.asarray(grid.log_odds)


def _checked_log_odds(states: np.ndarray, log_odds: np.ndarray) -> np.ndarray:
    # Log-odds of unknown voxels are not written, so they may be anything.
    is_known = states != UNKNOWN
    if not np.isfinite(log_odds[is_known]).all():
        raise InputError("log_odds must be finite where the grid is known, but some are NaN or infinite")
    contradicts = is_known & ((states == OCCUPIED) != (log_odds >= 0))
    if contradicts.any():
        raise InputError(
            f"log_odds of {np.count_nonzero(contradicts):,} voxels contradict their states (occupied means 0 "
            "or more), and .ot keeps only log-odds; drop log_odds or make them agree"
        )
    return log_odds


def _check_size(stated: int, found: int) -> None:
    if stated != found:
        raise InputError(f"the header says {stated:,} nodes, but the data hold {found:,}")
