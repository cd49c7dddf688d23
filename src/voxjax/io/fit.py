"""Whether a map as leaves has room as a grid in blocks; where it has none, one sentence says what would help."""

import bisect
import math

from .._checks import InputError
from .._types import OCCUPIED
from ..ops.blocks.block_array import lattice_shape
from .block_need import cutting_bytes, most_bytes, painting_bytes
from .budget import Budget
from .canvas import canvas_for
from .leaf_strays import split_leaves, stray_bytes
from .leaves import LeafMap

MAX_BLOCKS = 2**31 - 1
"""Most blocks of a box: rows of the table are counted in int32."""


def check_fit(leaves: LeafMap, budget: Budget, voxel_size: float) -> None:
    """Raise if a grid is larger than it may be.

    Args:
        leaves: The map, not empty.
        budget: What reading its file may take.
        voxel_size: Width of the grid's voxels [m].

    Raises:
        InputError: If the grid has more voxels or takes more memory than the budget has, or has more blocks than are
            counted.
    """
    shape = _shape_at(leaves, voxel_size)
    excess = _excess(leaves, budget, voxel_size)
    if excess is None:
        return
    size = " x ".join(map(str, shape))
    num_occupied = leaves.count(OCCUPIED)
    box = f"the map of {size} voxels of {voxel_size:g} m ({num_occupied:,} occupied in the file)"
    raise InputError(f"{box} {excess}; {', or '.join(_ways_out(leaves, budget, voxel_size, shape))}")


def _excess(leaves: LeafMap, budget: Budget, voxel_size: float) -> str | None:
    """What is too much about a grid, as the end of a main clause; None if it has room."""
    shape = _shape_at(leaves, voxel_size)
    if budget.max_voxels is not None and math.prod(shape) > budget.max_voxels:
        return f"has more than the limit of {budget.max_voxels:,} voxels"
    if math.prod(lattice_shape(shape)) > MAX_BLOCKS:
        return f"has more than {MAX_BLOCKS:,} blocks of 8 x 8 x 8 voxels"
    # What is surely enough, or surely too much, is told without a look at the leaves.
    excess = None
    for need_of in (most_bytes, cutting_bytes, painting_bytes):
        excess = budget.excess(need_of(leaves, voxel_size, shape))
        if (excess is None) == (need_of is most_bytes):
            break
    return excess


def _ways_out(leaves: LeafMap, budget: Budget, voxel_size: float, shape: tuple[int, ...]) -> list[str]:
    """What a user can do to have a map that is too large, the best first."""
    ways = []
    # Whoever has no memory to look for isolated pieces has none to drop them either.
    if budget.excess(stray_bytes(leaves)) is None:
        rest, found = split_leaves(leaves)
        # A piece beside a map that is large anyway is not what makes it so.
        if len(found.distance) and _excess(rest, budget, voxel_size) is None:
            count, size = int(found.num_voxels.sum()), " x ".join(map(str, _shape_at(rest, voxel_size)))
            voxels = "1 voxel" if count == 1 else f"{count:,} voxels"
            ways.append(
                f"leave out its isolated pieces ({voxels} up to {found.distance[0]:.4g} m from the rest) "
                f"with drop_isolated=True (--drop-isolated), so that the box is {size}"
            )
    larger = _voxel_size_that_fits(leaves, budget, voxel_size)
    if larger is not None:
        ways.append(f"take voxel_size={larger:g} (--voxel-size {larger:g}), at which it fits")
    ways.append("cut it with crop= (--crop)")
    if budget.max_voxels is not None and math.prod(shape) > budget.max_voxels:
        ways.append("raise max_voxels if there is memory for it")
    elif math.prod(lattice_shape(shape)) <= MAX_BLOCKS:
        ways.append(budget.memory_advice)
    return ways


def _voxel_size_that_fits(leaves: LeafMap, budget: Budget, voxel_size: float) -> float | None:
    """The smallest whole multiple of a voxel size [m] at which a grid has room; None if there is none."""
    # Nobody needs voxels finer than those of the file, if these fit.
    step = max(voxel_size, leaves.resolution)

    def fits(factor: int) -> bool:
        return _excess(leaves, budget, factor * step) is None

    most = 1
    while not fits(most):
        # The leaves alone may be too many.
        if max(_shape_at(leaves, most * step)) == 1:
            return None
        most *= 2
    # A map takes less memory the larger its voxels are.
    return step * (1 + bisect.bisect_left(range(1, most), True, key=fits))


def _shape_at(leaves: LeafMap, voxel_size: float) -> tuple[int, ...]:
    """Number of voxels along x, y, z of the grid of a map."""
    if voxel_size < leaves.resolution:
        # A canvas has an entry for each voxel along an axis, of which there may be any number.
        return tuple(math.ceil(count * (leaves.resolution / voxel_size)) for count in leaves.shape)
    return canvas_for(leaves, voxel_size).shape
