"""Fusion into a Zarr store: window by window, each written before the next is fused."""

import itertools
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int

from .._checks import InputError, check_count, shown
from .._runtime.memory import check_memory
from .._runtime.processes import run_in_processes
from .._runtime.whole_files import check_writable, write_files
from .._runtime.whole_folders import Folder
from ..grid import VoxelGrid
from ..io.map_files import read_map
from ..io.zarr_chunks import MARKER
from ..io.zarr_reading import check_zarr_support
from ..io.zarr_shards import SHARD, SIDE
from ..io.zarr_writing import MapStore, Window, encode_zarr
from ..ops.blocks.words import BLOCK
from .nearest import ADVICE, BlockFusion, FusedBlocks

_WINDOW = 2 * SIDE
"""Sides of the windows [voxel]."""


def check_out(out: object) -> Path:
    """The name of a store that is to be written.

    Raises:
        InputError: If it is no name ending in .zarr, cannot be written, or the package zarr is not installed.
    """
    if not isinstance(out, (str, os.PathLike)) or Path(out).suffix.lower() != ".zarr":
        raise InputError(f"out must be the name of a store, ending in .zarr, got {shown(out)}.")
    check_zarr_support()
    return check_writable(out, force=True, marker=MARKER)


def check_processes(num_processes: object, out: object) -> int:
    """How many processes are to share the fusion into a store.

    Args:
        num_processes: What the caller gave.
        out: Name of the store, or None.

    Raises:
        InputError: If it is no whole number from 1 on, or more than 1 without a store.
    """
    count = check_count("num_processes", num_processes, least=1)
    if count > 1 and out is None:
        raise InputError(f"num_processes is for out, got {count} and no out; give out, or leave it at 1.")
    return count


def check_memory_of_processes(num_processes: int, num_maps: int, rule: str) -> None:
    """Refuse more processes than the memory bears, whatever the maps hold, before they are registered.

    Args:
        num_processes: How many share the fusion.
        num_maps: How many maps are fused.
        rule: One of `rules.RULES`.

    Raises:
        InputError: If the memory does not suffice.
    """
    if num_processes > 1:
        need = _shared_need(num_processes, num_maps, rule)
        check_memory(need, f"a fused map written by {num_processes} processes", "take fewer of these")


def _shared_need(num_processes: int, num_maps: int, rule: str, copies: float = 0.0) -> float:
    """Memory of processes that share a fusion [byte]: each is an interpreter with all packages and its maps."""
    return num_processes * (store_fuse_memory(num_maps, rule) + 0.3e9 + copies)


def fuse_into_store(
    plan: BlockFusion | None, nothing: VoxelGrid, out: Path, *, num_processes: int = 1
) -> VoxelGrid:
    """Fuse maps into a store, which appears whole or not at all.

    Args:
        plan: What is fused, and where the result lies; None where nothing is known.
        nothing: The map for that case.
        out: Name of the store; an older one is replaced.
        num_processes: How many share the work; 1 is this one.

    Returns:
        The map in the store, opened.

    Raises:
        InputError: If the memory does not suffice for the windows, or the store cannot be written.
    """
    if plan is None:
        folder = encode_zarr(nothing)
    else:
        size = " x ".join(map(str, plan.shape))
        what = f"a fused map of {size} voxels of {plan.voxel_size:g} m, written window by window,"
        need, advice = store_fuse_memory(len(plan.sources), plan.rule), ADVICE
        if num_processes > 1:
            what = f"{what} by {num_processes} processes"
            advice = f"take fewer of these, or {ADVICE}"
            copies = float(sum(source.num_bytes for source in plan.sources))
            need = _shared_need(num_processes, len(plan.sources), plan.rule, copies)
        check_memory(need, what, advice)
        folder = Folder(partial(_write, plan, num_processes), MARKER)
    write_files({out: folder}, force=True)
    return read_map(out)


def store_fuse_memory(num_maps: int, rule: str, *, fixed: float = 0.25e9) -> float:
    """Estimated peak beside maps in memory and the running process [byte].

    Args:
        num_maps: Number of maps.
        rule: One of `rules.RULES`.
        fixed: Compiled kernels, and the blocks that are looked up at a time [byte].
    """
    per_voxel, num_arrays = (5, 2) if rule == "log_odds" else (1, 1)
    # A window and the blocks around it, in a map that is turned about all axes: dense, in blocks, and on the device.
    reach = (1.74 * _WINDOW + 3 * BLOCK) ** 3
    # Beside it are the chunks that each map keeps of what it has read.
    return fixed + num_maps * (3.0 * per_voxel * reach + num_arrays * 0.07e9)


def _write(plan: BlockFusion, num_processes: int, folder: Path) -> None:
    """Make the store."""
    has_log_odds = plan.rule == "log_odds"
    store = MapStore.make(folder, plan.shape, plan.origin, plan.voxel_size, has_log_odds=has_log_odds)
    # A process that has no shard to write need not be started.
    count = len(list(itertools.islice(_shards(plan), num_processes)))
    if count <= 1:
        write_share(plan, store, 0, 1)
    else:
        run_in_processes(write_share, [(plan, store, index, count) for index in range(count)])


def write_share(plan: BlockFusion, store: MapStore, index: int, count: int) -> None:
    """Fuse one process's share of the shards of a store, which no other share has.

    Args:
        plan: What is fused.
        store: Where it goes.
        index: Which share, from 0 on.
        count: How many there are.
    """
    # Neighbours go to different processes: what is known lies in few places, and all are to get some of each.
    for place in itertools.islice(_shards(plan), index, None, count):
        store.write(place, _fused_windows(plan, *store.shard_box(place)))


def _shards(plan: BlockFusion) -> Iterator[Int[np.ndarray, "3"]]:
    """Shards of a store in which maps may know something, in lexicographic order."""
    shape = np.asarray(plan.shape, np.int64)
    for large in _numbers(np.zeros(3, np.int64), shape, 4 * SHARD):
        begin = large * 4 * SHARD
        end = np.minimum(begin + 4 * SHARD, shape)
        # Shards of shards: where the lattice is empty, few are looked at.
        if _holds_any(plan, begin, end):
            for place in 4 * large + _numbers(begin, end, SHARD):
                if _holds_any(plan, place * SHARD, np.minimum((place + 1) * SHARD, shape)):
                    yield place


def _fused_windows(plan: BlockFusion, begin: np.ndarray, end: np.ndarray) -> Iterator[Window]:
    """Windows of a shard in which a map knows something."""
    for number in _numbers(begin, end, _WINDOW):
        low = begin + number * _WINDOW
        high = np.minimum(low + _WINDOW, end)
        if not _holds_any(plan, low, high):
            continue
        sides = -(-(high - low) // BLOCK) * BLOCK
        states = np.zeros(sides, np.uint8)
        log_odds = np.zeros(sides, np.float32) if plan.rule == "log_odds" else None
        for blocks in plan.blocks_in(low // BLOCK, -(-high // BLOCK)):
            _paste(states, low, blocks, blocks.states)
            if log_odds is not None:
                _paste(log_odds, low, blocks, blocks.log_odds)
        inside = tuple(map(slice, high - low))
        yield low, states[inside], None if log_odds is None else log_odds[inside]


def _holds_any(plan: BlockFusion, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether any map may know something between two voxels."""
    return plan.holds_any(low // BLOCK, -(-high // BLOCK))


def _numbers(begin: np.ndarray, end: np.ndarray, side: int) -> Int[np.ndarray, "m 3"]:
    """Numbers of the cubes along x, y, z that fill a box, from 0 on."""
    return np.argwhere(np.ones(-(-(end - begin) // side), bool))


def _paste(target: np.ndarray, low: np.ndarray, blocks: FusedBlocks, values: np.ndarray | None) -> None:
    """Put blocks into a window of whole blocks."""
    assert values is not None
    a, b, c = (side // BLOCK for side in target.shape)
    x, y, z = (blocks.places - low // BLOCK).T
    # One number for each block fills it.
    filled = values[:, None, None, None] if values.ndim == 1 else values
    target.reshape(a, BLOCK, b, BLOCK, c, BLOCK)[x, :, y, :, z] = filled
