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
from ..ops.blocks.block_array import BlockArray
from ..ops.blocks.block_builder import BlockBuilder
from .block_tree import families, words_of
from .budget import Budget
from .canvas import canvas_for
from .crop import check_crop, nothing_within
from .fit import check_fit
from .leaf_parts import cut_leaves
from .leaf_strays import split_leaves, stray_bytes
from .leaves import NUM_KEYS, LeafMap
from .octomap_header import BINARY_LINE, FULL_LINE, write_header
from .octomap_leaves import PLAIN_NODE, leaves_of_bt, leaves_of_ot
from .octree import INNER
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
        InputError: If the grid does not lie on OctoMap's lattice or within its range, or there is not enough memory.
    """
    states, low = grid.state_blocks(), _lowest_key(grid)
    if low is None:
        return write_header(BINARY_LINE, 0, grid.voxel_size)
    _check_nodes(states, ".bt", bytes_per_inner=35, bytes_per_leaf=0)
    order, words, num_nodes = [], [], 1
    for some in families(states, None, low):
        # The word of an inner node holds two bits for each child; leaves have no word of their own.
        order.append(some.order_of(some.depth, some.parent))
        words.append(words_of(some.code))
        num_nodes += int(np.count_nonzero(some.code))
    sorted_words = np.concatenate(words)[np.argsort(np.concatenate(order))]
    return write_header(BINARY_LINE, num_nodes, grid.voxel_size) + sorted_words.astype("<u2").tobytes()


def encode_ot(grid: VoxelGrid) -> bytes:
    """Bytes of the pruned `.ot` file of a grid.

    A grid without log-odds gets OctoMap's clamping values, 3.51 for occupied and -2.0 for free voxels.

    Raises:
        InputError: If the grid does not lie on OctoMap's lattice or within its range, its log-odds are not finite or
            contradict its states, or there is not enough memory.
    """
    states, low = grid.state_blocks(), _lowest_key(grid)
    if low is None:
        return write_header(FULL_LINE, 0, grid.voxel_size)
    log_odds = grid.log_odds_blocks()
    _check_nodes(states, ".ot", bytes_per_inner=50, bytes_per_leaf=50)
    if log_odds is not None:
        _check_log_odds(states, log_odds)
    # What stands for unknown voxels is never written.
    levels = np.array([0.0, LOG_ODDS_FREE, LOG_ODDS_OCCUPIED], np.float32) if log_odds is None else None
    order, nodes = [], []
    for some in families(states, log_odds, low, levels):
        assert some.value is not None
        is_child = some.code != 0
        inner = np.zeros(len(some.parent), PLAIN_NODE)
        inner["children"] = np.packbits(is_child, axis=1, bitorder="little")[:, 0]
        # An inner node has the highest log-odds below it.
        inner["log_odds"] = np.where(is_child, some.value, np.float32(-np.inf)).max(axis=1)
        family, child = np.nonzero(is_child & (some.code != INNER))
        leaf = np.zeros(len(family), PLAIN_NODE)
        leaf["log_odds"] = some.value[family, child]
        order += [
            some.order_of(some.depth, some.parent),
            some.order_of(some.depth + 1, some.parent[family] << 3 | child),
        ]
        nodes += [inner, leaf]
    sorted_nodes = np.concatenate(nodes)[np.argsort(np.concatenate(order))]
    return write_header(FULL_LINE, len(sorted_nodes), grid.voxel_size) + sorted_nodes.tobytes()


def check_reach(grid: VoxelGrid) -> None:
    """Refuse a grid that lies farther from zero than OctoMap counts voxels.

    Raises:
        InputError: If it does.
    """
    first, end = grid.known_box()
    low = np.rint(np.asarray(grid.origin, np.float64) / grid.voxel_size).astype(np.int64) + NUM_KEYS // 2
    _check_keys(low + first, low + end)


def _check_keys(first: np.ndarray, end: np.ndarray) -> None:
    """Refuse keys that OctoMap does not have: the lowest of what is known, and one past the highest."""
    if (first < 0).any() or (end > NUM_KEYS).any():
        raise InputError(
            f"OctoMap files reach {NUM_KEYS // 2} voxels from the frame's origin along each axis, and this "
            f"grid lies farther out, from voxel {(first - NUM_KEYS // 2).tolist()}; move it (VoxelGrid.placed, "
            "voxjax convert --shift) or use .npz"
        )


def _check_nodes(states: BlockArray, ending: str, *, bytes_per_inner: int, bytes_per_leaf: int) -> None:
    """Refuse a map for whose nodes the memory does not suffice.

    Args:
        states: The map.
        ending: Ending of the file to write.
        bytes_per_inner: What an inner node takes until it is written [byte].
        bytes_per_leaf: What a leaf takes [byte].
    """
    known = np.count_nonzero(np.asarray(states.pool).reshape(len(states.pool), -1), axis=1)
    is_mixed = ~states.is_uniform
    # A block has 73 inner nodes at most; those of few voxels have three above each of these, and one is shared by some.
    num_inner = float(np.minimum(73, 3 * known[is_mixed]).sum())
    num_leaves = float(known[is_mixed].sum()) + float(states.uses[1:].sum())
    need = bytes_per_inner * num_inner + bytes_per_leaf * num_leaves
    check_memory(need, f"the map as {ending}", "write it as .npz", on_device=False)


def _lowest_key(grid: VoxelGrid) -> np.ndarray | None:
    """Key int64 (3,) of the grid's voxel (0, 0, 0), which may lie outside of the keys; None when nothing is known."""
    first, end = grid.known_box()
    if (first == end).all():
        return None
    cell = np.asarray(grid.origin, np.float64) / grid.voxel_size
    low = np.rint(cell).astype(np.int64)
    # A hundredth of a voxel off the lattice is rounding: float32 is good to 0.002 at OctoMap's farthest voxel.
    if np.abs(cell - low).max() > 0.01:
        raise InputError(
            f"OctoMap files need an origin at whole multiples of the voxel size {grid.voxel_size:g} m, got "
            f"{np.asarray(grid.origin).tolist()}; resample it first with with_voxel_size (--voxel-size)"
        )
    low += NUM_KEYS // 2
    _check_keys(low + first, low + end)
    return low


def _check_log_odds(states: BlockArray, log_odds: BlockArray) -> None:
    """Refuse log-odds that no file can hold beside states."""
    num_bad = 0
    for index, known in states.parts():
        values = np.asarray(log_odds.pool)[np.asarray(log_odds.table)[tuple(index.T)]]
        # Log-odds of unknown voxels are not written, so they may be anything.
        is_known = known != UNKNOWN
        if not np.isfinite(values[is_known]).all():
            raise InputError("log_odds must be finite where the grid is known, but some are NaN or infinite")
        num_bad += int(np.count_nonzero(is_known & ((known == OCCUPIED) != (values >= 0))))
    if num_bad:
        raise InputError(
            f"log_odds of {num_bad:,} voxels contradict their states (occupied means 0 "
            "or more), and .ot keeps only log-odds; drop log_odds or make them agree"
        )
