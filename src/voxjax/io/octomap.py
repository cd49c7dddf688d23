"""OctoMap files, `.bt` (occupied or free) and `.ot` (log-odds), without OctoMap.

OctoMap's voxel k fills `[k - 32768, k - 32767) * resolution` along an axis, so the origin of a grid (the
outer corner of its lowest voxel) is a whole multiple of the voxel size; other grids must be resampled
first.
"""

import math
from collections.abc import Callable

import numpy as np

from .._checks import InputError, check_voxel_size
from .._runtime.memory import check_memory
from .._types import OCCUPIED, UNKNOWN
from ..grid import VoxelGrid
from ..maps.isolated import IsolatedPieces
from ..ops.blocks.block_array import BlockBuilder
from .budget import Budget
from .canvas import canvas_for
from .crop import check_crop, nothing_within
from .fit import check_fit
from .leaf_parts import cut_leaves
from .leaf_strays import split_leaves, stray_bytes
from .leaves import DEPTH, NUM_KEYS, LeafMap
from .octomap_header import BINARY_LINE, FULL_LINE, write_header
from .octomap_leaves import PLAIN_NODE, leaves_of_bt, leaves_of_ot
from .octree import INNER, TreeLevel, children_of, pre_order, prune
from .paint import paint

# What OctoMap gives to the leaves of a binary file: its clamping thresholds, probabilities 0.971 and 0.1192.
LOG_ODDS_OCCUPIED = np.float32(math.log(0.971 / 0.029))
LOG_ODDS_FREE = np.float32(math.log(0.1192 / 0.8808))


def decode_bt(
    data: bytes,
    *,
    voxel_size: float | None = None,
    crop: object = None,
    drop_isolated: bool = False,
    note: Callable[[IsolatedPieces], None] | None = None,
    max_voxels: int | None = None,
) -> VoxelGrid:
    """Read the bytes of a `.bt` file; the grid is the bounding box of the known voxels, without log-odds.

    What is asked for is done to the leaves of the tree, which go straight into blocks: the result is that of reading
    all voxels and, in this order, of `crop.crop_grid`, `strays.without_strays` and `VoxelGrid.with_voxel_size`.

    Args:
        data: The whole file.
        voxel_size: Width of the result's voxels [m]; None for the file's.
        crop: Low and high corner [m] of what is kept, by the centres of the file's voxels; None for all.
        drop_isolated: Whether isolated far pieces are left out.
        note: Called with the isolated pieces in metres (`leaf_strays.split_leaves`), none of them or dropped ones too,
            before anything is refused for its size. Without it, and without `drop_isolated`, nobody looks.
        max_voxels: Largest box; None for no limit but the memory that a file of this size can need.

    Raises:
        InputError: If the bytes are no whole binary OctoMap file, nothing lies in the crop, or what is asked for has
            more voxels than the limit or needs more memory than the file may take.
    """
    budget = Budget(len(data), max_voxels)
    leaves = chosen_leaves(leaves_of_bt(data, budget), budget, crop, drop_isolated=drop_isolated, note=note)
    return _painted(leaves, budget, voxel_size)


def decode_ot(
    data: bytes,
    *,
    voxel_size: float | None = None,
    crop: object = None,
    drop_isolated: bool = False,
    note: Callable[[IsolatedPieces], None] | None = None,
    max_voxels: int | None = None,
) -> VoxelGrid:
    """Read the bytes of an `.ot` file; log-odds are kept, and a voxel is occupied where they are 0 or more.

    Args:
        data: The whole file.
        voxel_size: As in `decode_bt`.
        crop: As in `decode_bt`.
        drop_isolated: As in `decode_bt`.
        note: As in `decode_bt`.
        max_voxels: As in `decode_bt`.

    Raises:
        InputError: If the bytes are no whole OctoMap file of OcTree or ColorOcTree nodes or hold log-odds that are not
            finite; and as in `decode_bt`.
    """
    budget = Budget(len(data), max_voxels)
    leaves = chosen_leaves(leaves_of_ot(data, budget), budget, crop, drop_isolated=drop_isolated, note=note)
    return _painted(leaves, budget, voxel_size)


def chosen_leaves(
    leaves: LeafMap,
    budget: Budget,
    crop: object,
    *,
    drop_isolated: bool,
    note: Callable[[IsolatedPieces], None] | None,
) -> LeafMap:
    """What is left of a map by crop and isolation.

    Args:
        leaves: All that its file holds.
        budget: What reading the file may take.
        crop: As in `decode_bt`.
        drop_isolated: As in `decode_bt`.
        note: As in `decode_bt`.

    Raises:
        InputError: If nothing lies in the crop, or there is no memory to look for isolated pieces.
    """
    if crop is not None:
        corners = check_crop(crop)
        whole, leaves = leaves, leaves.within(corners)
        if whole.levels and not leaves.levels:
            raise nothing_within(corners, whole.extent)
    if leaves.levels and (drop_isolated or note is not None):
        budget.check(stray_bytes(leaves), "the search for isolated pieces")
        rest, found = split_leaves(leaves)
        # A map without a surface has nothing to be isolated from.
        if note is not None and len(found.piece):
            note(found)
        leaves = rest if drop_isolated else leaves
    return leaves


def _painted(leaves: LeafMap, budget: Budget, voxel_size: float | None) -> VoxelGrid:
    """The grid of a map's leaves; one unknown voxel for a map that has none."""
    voxel_size = leaves.resolution if voxel_size is None else check_voxel_size(voxel_size)
    if not leaves.levels:
        kinds = (np.uint8, np.float32) if leaves.has_log_odds else (np.uint8,)
        states, *log_odds = (BlockBuilder((1, 1, 1), kind).finish() for kind in kinds)
        return VoxelGrid(states, np.zeros(3), voxel_size, *log_odds)
    check_fit(leaves, budget, voxel_size)
    canvas = canvas_for(leaves, voxel_size)
    states, log_odds = paint(cut_leaves(leaves, canvas), canvas)
    return VoxelGrid(states, canvas.origin, voxel_size, log_odds)


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
        node = np.zeros(len(index), PLAIN_NODE)
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
