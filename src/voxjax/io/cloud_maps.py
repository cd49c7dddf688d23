"""A map of a cloud of points: its voxel size, given or estimated, the cuts that were asked for, and its remarks."""

from typing import NamedTuple

import numpy as np

from .._checks import InputError, check_voxel_size
from ..grid import VoxelGrid
from ..maps import findings
from ..maps.findings import Remark
from ..maps.isolated import isolated_pieces
from ..ops.resampling.from_points import grid_from_points
from .budget import Budget
from .clouds import (
    Cloud,
    OrderedPoints,
    check_no_duplicates,
    check_precision,
    chosen_spacing,
    filled_voxels,
    ordered_points,
    spacing_of,
    usable_cloud,
)
from .crop import check_crop, crop_grid, nothing_within
from .placement import Placement
from .ply import decode_ply
from .spacing import Spacing
from .strays import piece_remarks


class ReadOptions(NamedTuple):
    """How a map is read; the fields are those of `read_map`.

    Attributes:
        voxel_size: Edge length of a voxel [m]; None estimates that of a cloud.
        crop: Low and high corner of the box to cut to [m]; None keeps all.
        drop_isolated: Whether isolated far pieces are left out.
        strict: Whether points of a cloud that are no places, or equal, are an error.
        sensor_origins: Where the points of a cloud were seen from [m]; None if that is not known.
        max_range: Longest ray [m].
        max_voxels: Largest box of voxels to make.
        placement: What is done to all places before there are voxels of the size that was asked for, after the crop;
            None for nothing.
        looks: Whether to look for all that may be wrong, beside what has to be said anyway.
    """

    voxel_size: float | None = None
    crop: object = None
    drop_isolated: bool = False
    strict: bool = False
    sensor_origins: object = None
    max_range: float | None = None
    max_voxels: int | None = None
    placement: Placement | None = None
    looks: bool = False


def cloud_map(data: bytes, options: ReadOptions) -> tuple[VoxelGrid, list[Remark]]:
    """The map of the bytes of a `.ply` file, and what a person should know about it.

    Raises:
        InputError: If the bytes are no cloud, it has no points to use, or an option does not fit.
    """
    budget = Budget(len(data), options.max_voxels)
    cloud = usable_cloud(decode_ply(data), options.sensor_origins, strict=options.strict)
    is_ordered = options.looks or options.strict or options.voxel_size is None
    # The most that was seen is 117 bytes for a point, and 194 beside a tree of them where they are put in order.
    budget.check((250 if is_ordered else 150) * len(cloud.points), "the cloud")
    remarks = [findings.dropped_remark(cloud.num_dropped, cloud.num_rows)]
    cloud = _within(cloud, options.crop)
    ordered = ordered_points(cloud.points) if is_ordered else None
    if options.strict and ordered is not None:
        check_no_duplicates(ordered)
    voxel_size, spacing = _voxel_size(cloud, ordered, options)
    if options.placement is not None:
        # What single precision has lost was looked for among the numbers of the file.
        cloud = options.placement.of_cloud(cloud)
        options = options._replace(crop=options.placement.of_crop(options.crop))
    if options.voxel_size is None and spacing is not None:
        remarks.append(findings.estimate_remark(voxel_size, spacing.closing, spacing.lattice))
    reasons = []
    if ordered is not None and spacing is not None and options.looks:
        remarks.append(findings.duplicates_remark(ordered.points, ordered.is_first))
        remarks.append(findings.faces_remark(cloud.points, voxel_size))
    if options.looks or options.drop_isolated:
        cloud, reasons = _without_strays(cloud, voxel_size, spacing, is_dropped=options.drop_isolated)
    try:
        grid = _grid(cloud, voxel_size, options, budget)
    except InputError as error:
        # A box that is too large has a reason as a rule.
        text = "; ".join([str(error).removesuffix("."), *(reason.text for reason in reasons)])
        raise InputError(text) from error
    return grid, [remark for remark in remarks if remark is not None] + reasons


def _voxel_size(
    cloud: Cloud, ordered: OrderedPoints | None, options: ReadOptions
) -> tuple[float, Spacing | None]:
    """Of the map as it will lie: voxel size [m], and how far apart its points lie, None where nobody asks for that."""
    placement = options.placement
    if options.voxel_size is not None:
        voxel_size = check_voxel_size(options.voxel_size)
        in_file = voxel_size if placement is None else voxel_size / placement.scale
        check_precision(cloud.points, in_file, f"voxels of {in_file:g} m")
        if not options.looks or ordered is None:
            return voxel_size, None
        spacing = spacing_of(ordered, cloud.points.dtype)
        return voxel_size, spacing if placement is None else placement.of_spacing(spacing)
    assert ordered is not None
    spacing = chosen_spacing(ordered, cloud.points)
    spacing = spacing if placement is None else placement.of_spacing(spacing)
    return spacing.voxel_size, spacing


def _without_strays(
    cloud: Cloud, voxel_size: float, spacing: Spacing | None, *, is_dropped: bool
) -> tuple[Cloud, list[Remark]]:
    """The cloud, without its isolated pieces if they are dropped, and remarks that explain a large box."""
    index = filled_voxels(cloud.points, voxel_size)
    pieces = isolated_pieces(index * voxel_size, voxel_size=voxel_size)
    remarks = []
    if spacing is not None:
        apart = spacing.closing if spacing.lattice is None else spacing.lattice
        remarks = piece_remarks(pieces, apart, is_dropped=is_dropped)
    if is_dropped and len(pieces.distance):
        # What is isolated is farther from the main part than that is wide, and so outside of its box.
        main = index[pieces.piece < 0]
        places = np.floor(cloud.points.astype(np.float64) / voxel_size)
        cloud = cloud.keep(((places >= main.min(axis=0)) & (places <= main.max(axis=0))).all(axis=1))
    return cloud, remarks


def _grid(cloud: Cloud, voxel_size: float, options: ReadOptions, budget: Budget) -> VoxelGrid:
    """The voxels that hold points, and those that rays cross, cut to the box that was asked for."""
    # Rays cross the whole box, and their marks take five bytes a voxel; points alone go into blocks.
    most = budget.max_voxels
    if cloud.sensor_origins is not None:
        most = int(min(budget.most_voxels, budget.memory()[0] / 5))
    states, origin = grid_from_points(
        cloud.points,
        voxel_size=voxel_size,
        sensor_origins=cloud.sensor_origins,
        max_range=options.max_range,
        max_voxels=most,
    )
    grid = VoxelGrid(states, origin, voxel_size)
    # Without sensors, the points were cut already.
    if options.crop is None or cloud.sensor_origins is None:
        return grid
    return crop_grid(grid, options.crop)


def _within(cloud: Cloud, crop: object) -> Cloud:
    """The points in the box. With sensors all are kept: their rays cross the box, and the map is cut after that."""
    if crop is None or cloud.sensor_origins is not None:
        return cloud
    low, high = check_crop(crop)
    is_inside = np.asarray(((cloud.points >= low) & (cloud.points < high)).all(axis=1))
    if not is_inside.any():
        raise nothing_within((low, high), (cloud.points.min(axis=0), cloud.points.max(axis=0)))
    return cloud.keep(is_inside)
