"""The lattice of whole multiples of the voxel size, on which all resampled and fused grids lie."""

import numpy as np
from jaxtyping import Float, Int, Real

from ..._checks import InputError
from ...frames import image
from ..blocks.block_array import BlockArray
from .outermost import outermost
from .stored import Stored

MAX_VOXELS = 2**31 - 1
"""Largest dense grid: flat indices fit int32."""


def origin_in_voxels(origin: Float[np.ndarray, "3"], voxel_size: float) -> Float[np.ndarray, "3"]:
    """Origin in units of the voxel size, float64; whole numbers where the origin lies on the lattice."""
    # An origin this near to the lattice [voxels] lies on it; the rest is rounding, of float32 where the origin was kept
    # as such.
    on_lattice = 0.01
    cell = np.asarray(origin, np.float64) / voxel_size
    whole = np.rint(cell)
    return np.where(np.abs(cell - whole) < on_lattice, whole, cell)


def origin_of_cell(cell: Int[np.ndarray, "3"], voxel_size: float) -> Float[np.ndarray, "3"]:
    """Outer corner float64 [m] of a cell of the lattice."""
    # A product and no sum: equal cells have equal origins, however they came about.
    return np.asarray(cell, np.float64) * voxel_size


def about_middle(
    origin: Float[np.ndarray, "3"], shape: tuple[int, ...], voxel_size: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Where a grid lies in a local frame, whose zero is at a border of voxels in the middle of the grid.

    Args:
        origin: Outer corner [m].
        shape: Number of voxels along x, y, z.
        voxel_size: Width of the voxels [m].

    Returns:
        The grid's outer corner in the local frame, and the local frame's zero in that of `origin`, float64 [m].
    """
    middle = np.asarray(shape) // 2
    # Counted in voxels, the corner has the same digits whatever frame the grid is in. The place does not go onto the
    # lattice from near it: all that is found in the local frame would go with it, by a hundredth of a voxel.
    return -middle * voxel_size, np.asarray(origin, np.float64) + middle * voxel_size


def cell_of_image(
    T: Float[np.ndarray, "4 4"], point: Float[np.ndarray, "3"], voxel_size: float
) -> Int[np.ndarray, "3"]:
    """Cell of the lattice, int64 (3,), in which a pose puts a point [m]."""
    place = image(T, point)
    check_places(place, voxel_size, advice="check the poses, or choose an origin near the map")
    return np.floor(place / voxel_size).astype(np.int64)


def check_num_voxels(shape: Real[np.ndarray, "3"], what: str, advice: str, most: int = MAX_VOXELS) -> None:
    """Raise if a dense grid of that shape has too many voxels.

    Raises:
        InputError: If it has more than `most`.
    """
    # As whole numbers of Python they are multiplied without wrapping round.
    sides = [int(side) for side in shape]
    if sides[0] * sides[1] * sides[2] > most:
        size = " x ".join(f"{side:,}" if side < 1e12 else f"{side:.3g}" for side in sides)
        raise InputError(f"{what} would have {size} voxels, more than {most:,}; {advice}.")


def moved_bounds(
    states: np.ndarray | BlockArray | Stored,
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    T: Float[np.ndarray, "4 4"],
    target_voxel_size: float,
) -> tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]:
    """Cells of the target lattice whose centres the moved grid can fill.

    Under a rotation of the cube this is the whole moved grid, so that nothing is cut; under any other
    rotation it is the box around the moved known voxels, which is much smaller than the box around the
    moved grid.

    Args:
        states: uint8 (x, y, z), dense, in blocks or in a store.
        origin: Outer corner [m].
        voxel_size: Width of the grid's voxels [m].
        T: Pose that moves the grid.
        target_voxel_size: Width of the lattice's cells [m].

    Returns:
        Lowest cell and one past the highest, int64 (3,) each; equal when nothing is known.

    Raises:
        InputError: If the moved grid lies so far away that float64 cannot place its cells.
    """
    # A rotation this near to one of the 24 of the cube is that one: its box is not to grow by rounding.
    is_cube_rotation = 1e-5
    matrix = np.asarray(T, np.float64)
    rotation = matrix[:3, :3]
    base = origin_in_voxels(origin, voxel_size)
    if np.abs(rotation - np.rint(rotation)).max() < is_cube_rotation:
        low, high = np.zeros((1, 3)), np.asarray([states.shape], np.float64)
        centres, half = (low + high) / 2, high[0] / 2
    else:
        # A moved voxel is the lowest or highest along an axis if it lies outermost along a row of the rotation.
        known = outermost(states, np.concatenate([rotation, -rotation]))
        centres, half = known + 0.5, np.full(3, 0.5)
    if not len(centres) or not all(states.shape):
        return np.zeros(3, np.int64), np.zeros(3, np.int64)
    # A turned box reaches along each axis as far as its half edges do there together, hence the absolute values.
    moved = ((centres + base) @ rotation.T) * voxel_size + matrix[:3, 3]
    reach = np.abs(rotation) @ half * voxel_size
    low, high = moved.min(axis=0) - reach, moved.max(axis=0) + reach
    advice = "check the poses, or choose an origin near the map"
    check_places(np.concatenate([low, high]), target_voxel_size, advice=advice)
    # A cell belongs to the box if its centre does; the box is a little wider, so that rounding cuts no layer off.
    return (
        np.ceil(low / target_voxel_size - 0.5 - 1e-4).astype(np.int64),
        np.ceil(high / target_voxel_size - 0.5 + 1e-4).astype(np.int64),
    )


def check_places(
    places: np.ndarray,
    voxel_size: float,
    *,
    advice: str = "choose an origin near the map (VoxelGrid.placed, voxjax convert --shift)",
) -> None:
    """Refuse places [m] where float64 does not tell hundredths of a voxel apart.

    Args:
        places: Coordinates.
        voxel_size: Width of the voxels that lie there [m].
        advice: What to do instead.

    Raises:
        InputError: If they lie too far from the origin of their frame.
    """
    farthest = np.abs(np.asarray(places, np.float64)).max(initial=0)
    step = float(np.spacing(farthest))
    # A place is rounded by half of a step at most. NaN is no such number, too.
    if not step <= voxel_size / 50.0:
        raise InputError(
            f"a map with voxels of {voxel_size:g} m that reaches {farthest:.4g} m from the origin of its frame is "
            f"placed in steps of {step:.2g} m only; {advice}."
        )
