"""A box in metres that is cut out of a map: a voxel belongs to it if its centre does."""

import numpy as np

from .._checks import InputError, shown
from ..grid import VoxelGrid


class EmptyCrop(InputError):
    """A box in which a map knows nothing."""


def check_crop(crop: object) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box, float64 (3,) each [m]; infinite ones leave a side open.

    Args:
        crop: Low and high corner, (2, 3).

    Raises:
        InputError: If it is no such pair, or the low corner is not below the high one.
    """
    try:
        corners = np.asarray(crop, np.float64)
    except (TypeError, ValueError):
        corners = np.full(0, np.nan)
    if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():  # NaN is not below, too
        raise InputError(
            "crop must be a low and a high corner, three numbers in metres each, with the low one below the high "
            f"one along every axis, got {shown(crop)}."
        )
    return corners[0], corners[1]


def cells_within(
    crop: tuple[np.ndarray, np.ndarray], origin: np.ndarray, voxel_size: float, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Voxels of a grid whose centres lie in a box.

    A centre on the low face belongs to the box and one on the high face does not, so that boxes side by side share no
    voxel.

    Args:
        crop: Low and high corner [m].
        origin: Outer corner of the grid's voxel (0, 0, 0) [m].
        voxel_size: Width of a voxel [m].
        shape: Number of voxels along x, y, z.

    Returns:
        Index of the first voxel and one past the last, int64 (3,) each, within the grid; equal along an axis where
        there is none.
    """
    # Centres this near to a face [voxel] lie on it: what is written in decimals is rounded.
    tie = 1e-4
    ends = [np.ceil((corner - origin) / voxel_size - 0.5 - tie) for corner in crop]
    first, end = (np.clip(places, 0, shape).astype(np.int64) for places in ends)
    return first, np.maximum(first, end)


def crop_grid(grid: VoxelGrid, crop: object) -> VoxelGrid:
    """The box around what a map knows inside of a box.

    Args:
        grid: The map.
        crop: Low and high corner [m] in the map's frame.

    Raises:
        InputError: If `crop` is no box, or the map knows nothing there.
    """
    corners = check_crop(crop)
    first, end = cells_within(corners, np.asarray(grid.origin, np.float64), grid.voxel_size, grid.shape)
    part = grid.cut(first, end) if (first < end).all() else grid.cut(first, first)
    low, high = part.known_box()
    if (low == high).all():
        raise nothing_within(corners, grid.extent)
    return part.cut(low, high)


def nothing_within(crop: tuple[np.ndarray, np.ndarray], extent: tuple[np.ndarray, np.ndarray]) -> EmptyCrop:
    """The sentence for a box in which a map knows nothing.

    Args:
        crop: Low and high corner of the box [m].
        extent: Low and high corner of the map [m].
    """
    # Coordinates of a national grid have seven digits before the point.
    texts = ["(" + ", ".join(f"{value:.10g}" for value in corner) + ")" for corner in (*crop, *extent)]
    return EmptyCrop(
        f"the map knows nothing in the crop from {texts[0]} to {texts[1]} m; it spans {texts[2]} to {texts[3]} m."
    )
