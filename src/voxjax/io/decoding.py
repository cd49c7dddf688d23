"""A map of the bytes of a file of any format: decoded, cut as asked for, and looked over for what is odd about it."""

from pathlib import Path

import numpy as np

from .._checks import InputError
from ..grid import VoxelGrid
from ..maps.findings import Remark, grid_remarks
from ..maps.isolated import IsolatedPieces
from ..ops.resampling.lattice import check_places
from .budget import Budget
from .cloud_maps import ReadOptions as ReadOptions
from .cloud_maps import cloud_map
from .crop import crop_grid
from .kept_memory import KeptMemory, memory_of_leaves
from .map_facts import MapFacts, facts_of_leaves
from .npz import decode_npz
from .octomap import chosen_leaves, decode_bt, decode_ot
from .octomap_leaves import leaves_of_bt, leaves_of_ot
from .strays import piece_remarks, without_strays
from .zarr_reading import open_zarr

_DECODERS = {".bt": decode_bt, ".ot": decode_ot}
_LEAVES = {".bt": leaves_of_bt, ".ot": leaves_of_ot}
TREE_ENDINGS = tuple(_LEAVES)
"""Endings of files that hold trees."""


def decode_map(data: bytes, ending: str, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """The map in a file, and what was done to it or, if the options look for it, seen.

    Args:
        data: The whole file.
        ending: Its ending, one of those that can be read.
        options: How it is read.

    Raises:
        InputError: If the bytes are no map, or an option does not fit; the message is for a sentence that names the
            file.
    """
    if ending == ".ply":
        return cloud_map(data, options)
    _check_no_cloud(ending, options)
    if ending in TREE_ENDINGS:
        grid, remarks = _octree_map(data, ending, options)
    else:
        lost: list[Remark] = []
        grid = decode_npz(data, max_voxels=options.max_voxels, note=lost.append)
        grid, remarks = _cut_as_asked(grid, options)
        remarks = lost + remarks
    _check_place(grid)
    return grid, remarks


def decode_store(path: Path, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """The map in a Zarr store, of which no more is read than the options ask for, and what was seen.

    Args:
        path: The folder of the store.
        options: How it is read.

    Raises:
        InputError: As in `decode_map`.
    """
    _check_no_cloud(path.suffix, options)
    grid, remarks = _cut_as_asked(open_zarr(path, max_voxels=options.max_voxels), options)
    _check_place(grid)
    return grid, remarks


def describe_tree(
    data: bytes, ending: str, options: ReadOptions
) -> tuple[MapFacts, list[Remark], KeptMemory]:
    """Figures of an octree at its own voxel size, of which no grid is made, what was seen, and what memory it takes.

    Args:
        data: The whole file.
        ending: Its ending, one of `TREE_ENDINGS`.
        options: How it is read.

    Raises:
        InputError: As in `decode_map`.
    """
    budget, found = Budget(len(data), options.max_voxels), []
    leaves = chosen_leaves(
        _LEAVES[ending](data, budget),
        budget,
        options.crop,
        drop_isolated=options.drop_isolated,
        note=found.append,
    )
    return facts_of_leaves(leaves), _piece_remarks(found, options), memory_of_leaves(leaves, budget)


def with_box_remarks(remarks: list[Remark], facts: MapFacts) -> tuple[Remark, ...]:
    """Remarks about a map, and those about its box."""
    has_strays = any(remark.code == "isolated" and not remark.numbers["is_dropped"] for remark in remarks)
    num_known = facts.num_occupied + facts.num_free
    seen = grid_remarks(facts.low, facts.high, facts.voxel_size, num_known, has_strays=has_strays)
    # That positions are kept in float64 is no news of a map whose file has rounded its place.
    if any(remark.code == "rounded_origin" for remark in remarks):
        seen = [remark for remark in seen if remark.code != "far_frame"]
    return (*remarks, *seen)


def _octree_map(data: bytes, ending: str, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """The map of a file that holds a tree, whose leaves are cut before anything dense is made."""
    found: list[IsolatedPieces] = []
    placement = options.placement
    grid = _DECODERS[ending](
        data,
        # Voxels of the size that was asked for belong to the map where it will lie.
        voxel_size=options.voxel_size if placement is None else None,
        crop=options.crop,
        drop_isolated=options.drop_isolated,
        note=found.append if options.looks else None,
        max_voxels=options.max_voxels,
    )
    if placement is not None:
        grid, found = placement.of_grid(grid), [placement.of_pieces(pieces) for pieces in found]
        grid = grid if options.voxel_size is None else grid.with_voxel_size(options.voxel_size)
    return grid, _piece_remarks(found, options)


def _piece_remarks(found: list[IsolatedPieces], options: ReadOptions) -> list[Remark]:
    """What an octree's reader has noted, as remarks."""
    return [
        remark
        for pieces in found
        for remark in piece_remarks(pieces, pieces.voxel_size, is_dropped=options.drop_isolated)
    ]


def _check_no_cloud(ending: str, options: ReadOptions) -> None:
    """Refuse options that belong to clouds."""
    if options.sensor_origins is not None or options.max_range is not None:
        raise InputError(
            f"sensor_origins and max_range belong to clouds (.ply), not to {ending} maps; leave them out"
        )


def _cut_as_asked(grid: VoxelGrid, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """A map that holds all voxels, cut and brought to the voxel size that was asked for, and what was seen."""
    remarks = []
    grid = grid if options.crop is None else crop_grid(grid, options.crop)
    grid = grid if options.placement is None else options.placement.of_grid(grid)
    if options.looks or options.drop_isolated:
        grid, remarks = without_strays(grid, is_dropped=options.drop_isolated)
    return grid if options.voxel_size is None else grid.with_voxel_size(options.voxel_size), remarks


def _check_place(grid: VoxelGrid) -> None:
    """Refuse a map so far out that no number tells one voxel from the next, as its file or a shift may put it."""
    advice = "choose an origin near the map (shift=, voxjax convert --shift)"
    check_places(np.stack(grid.extent), grid.voxel_size, advice=advice)
