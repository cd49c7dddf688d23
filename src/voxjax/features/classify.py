"""Flat, edge and corner voxels, by how the occupied count changes when the window moves (section III)."""

import jax.numpy as jnp
from jaxtyping import UInt8

from .._checks import InputError, check_count, shown
from .._runtime.forks import refused_after_fork
from .._types import Array
from ..grid import VoxelGrid
from ..ops.window.box import check_shift, check_size
from ..ops.window.classes import Occupied, window_classes

EMPTY, FLAT, EDGE, CORNER = 0, 1, 2, 3


@refused_after_fork
def classify_voxels(
    occupied: Occupied, *, size: int = 7, shift: int = 4, min_change: int = 20
) -> UInt8[Array, "x y z"]:
    """Classify each voxel as not occupied, flat, edge or corner (section III).

    The paper calls a voxel an initial feature point "if the number of occupied cubes in the window changes
    significantly when moving the window in any direction". Here the directions are the 13 of the voxel
    lattice (both senses of each), the moves `shift` voxels along each axis, and a change is significant from
    `min_change` per cent of the count. On a plane several directions leave the count as it is, along an edge
    one does, at a corner none.

    Args:
        occupied: True (or not 0) where a voxel is occupied.
        size: Window edge [voxel]; odd.
        shift: Voxels moved along each axis of a direction, 1 to 64; the default takes the window off a face that it was
            centred on.
        min_change: Significant change [per cent of the count], 1 to 100.

    Returns:
        uint8: 0 not occupied, 1 flat, 2 edge, 3 corner.

    Raises:
        InputError: If `occupied` is no grid, or a number is out of its range.
    """
    if isinstance(occupied, VoxelGrid):
        raise InputError("occupied must be an array (x, y, z), got a VoxelGrid; give grid.states == 2.")
    # Before the kernel: whatever cannot be hashed is no static argument of one.
    size, shift = check_size(size), check_shift(shift)
    if check_count("min_change", min_change, 1) > 100:
        raise InputError(f"min_change must be a percentage from 1 to 100, got {shown(min_change)}.")
    return window_classes(occupied, jnp.int32(min_change), size=size, shift=shift)
